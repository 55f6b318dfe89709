#!/usr/bin/env python3
"""Fails when drivers/api changed and kDriverAbi did not; --record writes the new hash."""
import hashlib
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
RECORD = ROOT / "drivers/api/abi.txt"


def code_of(text):
    """The text without comments and white space: words may improve without a new ABI."""
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    text = re.sub(r"//[^\n]*", "", text)
    return re.sub(r"\s+", "", text)


def main():
    headers = sorted((ROOT / "drivers/api/alhazen").glob("*.h"))
    code = "".join(h.name + code_of(h.read_text()) for h in headers)
    number = re.search(r"kDriverAbi = (\d+)", (ROOT / "drivers/api/alhazen/driver.h").read_text())[1]
    now = f"{number} {hashlib.sha256(code.encode()).hexdigest()[:16]}"
    if sys.argv[1:] == ["--record"]:
        RECORD.write_text(now + "\n")
    recorded = RECORD.read_text().strip()
    if recorded == now:
        print(f"abi: {now}")
        return 0
    print(f"abi: drivers/api is '{now}' but '{recorded}' is recorded.\n"
          "Raise kDriverAbi, add a line to the history in drivers/README.md, run tools/check_abi_hash.py --record.")
    return 1


if __name__ == "__main__":
    sys.exit(main())
