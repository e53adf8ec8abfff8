#!/usr/bin/env python3
"""Times of the last run of ctest, as a table: each test over 5 s, and what it alone proves.

usage: tools/test_times.py BUILD_FOLDER [SECONDS]     from which time on; default 5
       tools/test_times.py --self-test
Reads BUILD_FOLDER/Testing/Temporary/LastTest.log and tests/long_tests.txt. Exit 1 where a test of
the table has no line there.
"""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
NAME = re.compile(r"^\d+/\d+ Test: (\S+)$", re.M)
TIME = re.compile(r"^Test time = +([0-9.]+) sec$", re.M)


def times_of(log):
    """[(seconds, name)] of a log of ctest."""
    parts = NAME.split(log)[1:]
    return [(float(TIME.search(text).group(1)), name)
            for name, text in zip(parts[::2], parts[1::2]) if TIME.search(text)]


def reasons_of(text):
    lines = (line.split(": ", 1) for line in text.split("\n") if line and line[0] != "#")
    return {name: reason for name, reason in lines}


def table(times, reasons, least):
    """(lines, names without a reason)"""
    rows = sorted((t for t in times if t[0] >= least), reverse=True)
    lines = [f"| {name} | {seconds:.0f} | {reasons.get(name, '')} |" for seconds, name in rows]
    rest = sum(t for t, _ in times) - sum(t for t, _ in rows)
    lines.append(f"| {len(times) - len(rows)} others | {rest:.0f} | |")
    return lines, [name for _, name in rows if name not in reasons]


def self_test():
    log = ("1/2 Test: a\nx\nTest time =   7.50 sec\n\n2/2 Test: b\nTest time =  0.20 sec\n")
    good = table(times_of(log), reasons_of("# c\na: why\n"), 5)
    bad = table(times_of(log), {}, 0)
    right = good == (["| a | 8 | why |", "| 1 others | 0 | |"], []) and bad[1] == ["a", "b"]
    print(f"self-test: {'right' if right else (good, bad)}")
    return 0 if right else 1


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    log = (pathlib.Path(sys.argv[1]) / "Testing/Temporary/LastTest.log").read_text(errors="replace")
    reasons = reasons_of((ROOT / "tests/long_tests.txt").read_text())
    least = float(sys.argv[2]) if len(sys.argv) > 2 else 5
    lines, without = table(times_of(log), reasons, least)
    print("| test | s | what it alone proves |\n|---|---|---|")
    print("\n".join(lines))
    for name in without:
        print(f"{name}: tests/long_tests.txt does not say what it alone proves", file=sys.stderr)
    return 1 if without else 0


if __name__ == "__main__":
    sys.exit(main())
