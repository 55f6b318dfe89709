#!/usr/bin/env python3
"""Fails on an #include that tools/layers.toml does not allow. Needs Python 3.11 (tomllib)."""
import pathlib
import re
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
INCLUDE = re.compile(r'^\s*#\s*include\s*(["<])([^">]+)[">]')
SOURCES = ("drivers", "reconstruct", "daemon", "tools")
# Standard library and C library headers carry no dot and no folder, or are these.
SYSTEM = re.compile(r"^(std\w+\.h|c?\w+|(sys|linux|netinet|arpa)/\w+\.h|unistd\.h|fcntl\.h|dlfcn\.h|signal\.h|poll\.h|errno\.h|time\.h)$")


def module_of(path, modules):
    """The longest module folder that contains `path`."""
    fits = [m for m in modules if path == m or path.startswith(m + "/")]
    return max(fits, key=len) if fits else None


def complaints():
    modules = tomllib.loads((ROOT / "tools/layers.toml").read_text())["module"]
    for folder in SOURCES:
        for file in sorted((ROOT / folder).rglob("*")):
            if file.suffix not in (".h", ".cc"):
                continue
            path = str(file.relative_to(ROOT))
            module = module_of(path, modules)
            if module is None:
                yield f"{path}: belongs to no module of tools/layers.toml"
                continue
            law = modules[module]
            for number, line in enumerate(file.read_text().splitlines(), 1):
                match = INCLUDE.match(line)
                if not match:
                    continue
                quote, name = match.groups()
                where = f"{path}:{number}: "
                if quote == "<":
                    if SYSTEM.match(name) or name.split("/")[0] in law.get("third_party", []):
                        continue
                    yield where + f"<{name}> is not among the libraries of {module}"
                elif name.startswith("alhazen/"):
                    if module != "drivers/api" and "alhazen" not in law["includes"]:
                        yield where + f"{module} may not include drivers/api"
                else:
                    target = module_of(name, modules)
                    if target == module:
                        continue
                    allowed = law["includes"]
                    if not any(name == a or name.startswith(a + "/") for a in allowed):
                        yield where + f"{module} may not include {name}"


if __name__ == "__main__":
    found = list(complaints())
    print("\n".join(found) if found else "layers: every include is allowed")
    sys.exit(1 if found else 0)
