#!/usr/bin/env python3
"""clang-tidy on the files changed since the parent commit: check_tidy.py [--all]

--all takes every .cc, and with it every header. The compile commands are those of the preset tidy, file by file, so that a
file that forgets an include is found too. build/tidy/tidy.json remembers what was found clean. Such a file is passed over
until its text, that of a header of the project that it includes, its compile command or .clang-tidy changes.
"""
import concurrent.futures
import functools
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.M)


def run(*command, check=True):
    return subprocess.run(command, cwd=ROOT, check=check, capture_output=True, text=True)


@functools.cache
def text_of(file):
    return (ROOT / file).read_text()


def reached_from(source):
    """The source and the project's headers that it includes, directly or not."""
    reached, ahead = set(), [source]
    while ahead:
        file = ahead.pop()
        if file not in reached and (ROOT / file).is_file():
            reached.add(file)
            for name in INCLUDE.findall(text_of(file)):
                ahead += [name, "drivers/api/" + name]  # the two folders that the compiler searches
    return reached


def chosen(every):
    if every or not run("git", "rev-list", "--skip=1", "-n1", "HEAD").stdout:  # or there is no parent
        names = run("git", "ls-files", "--cached", "--others", "--exclude-standard", "*.cc").stdout
    else:
        names = run("git", "diff", "--name-only", "HEAD~1", "--", "*.cc", "*.h").stdout
        names += run("git", "ls-files", "--others", "--exclude-standard", "*.cc", "*.h").stdout
    return sorted(name for name in set(names.split()) if (ROOT / name).is_file())


def main(every):
    build = ROOT / "build/tidy"
    run("cmake", "--preset", "tidy")
    record = build / "tidy.json"
    clean = json.loads(record.read_text()) if record.exists() else {}
    commands = {c["file"]: c["command"] for c in json.loads((build / "compile_commands.json").read_text())}
    rules = run("clang-tidy-14", "--version").stdout + text_of(".clang-tidy")

    def key_of(file):
        parts = [rules, commands.get(str(ROOT / file), ""), *map(text_of, sorted(reached_from(file)))]
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()

    files = chosen(every)
    keys = {file: key_of(file) for file in files}
    due = [file for file in files if clean.get(file) != keys[file]]
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        tidy = functools.partial(run, "clang-tidy-14", "--quiet", "-p", str(build), check=False)
        for file, result in zip(due, pool.map(tidy, due)):
            if result.returncode == 0:
                clean[file] = keys[file]
                record.write_text(json.dumps(clean, indent=0))
            else:
                failed += 1
                print(result.stdout, result.stderr, flush=True)
    print(f"tidy: {len(due)} files looked at, {failed} with findings; {len(files) - len(due)} known to be clean")
    return 1 if failed else 0


if __name__ == "__main__":
    if sys.argv[1:] not in ([], ["--all"]):
        sys.exit(__doc__)
    sys.exit(main(every="--all" in sys.argv))
