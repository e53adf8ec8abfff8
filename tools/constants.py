#!/usr/bin/env python3
"""Which data chose which constant: docs/constants.md, from marks in the source.

A mark is a comment of one line that says

    chosen on: DATA; judged on: DATA

and ends the comment. DATA is free text without a semicolon; "not recorded" where nobody wrote it down, "nothing
else" where no other data was asked. Behind code it is of the constants of that line. On a line of its own, or
behind a brace that opens, it is of the constants down to the next blank line, closing brace or mark. A line whose comment says
"derived" or "no data" is of no mark.

usage: tools/constants.py [--check | --self-test]     without: writes the page
"""

import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = "docs/constants.md"
FOLDERS = ("rt", "config", "perception", "drivers", "tasks", "tools")
MARK = re.compile(r"\bchosen on:\s*(?P<chosen>[^;]+);\s*judged on:\s*(?P<judged>[^;]+?)\s*$")
CONSTANT = re.compile(r"(?<![\w:])\.?([A-Za-z_]\w*)\s*(?:=\s*|(?=\{[^{}]*\d))(\{[^{}]*\}|[^,;{}=]+)(?=[,;}]|\s*$)")
NUMBER = re.compile(r"(?<![\w.])[-+]?[\d.][\d.'eE+-]*[uUlLfF]*(?!\w)")

HEAD = """# Which data chose it

Written by `tools/constants.py` from marks in the source; do not edit. A constant that was chosen on data names that
data, and other data that it was judged on. What is derived, is a definition or stands in a norm has no mark.

- *not recorded*: the source does not say on what it was chosen, or whether on any data.
- *nothing else*: no data but that which chose it was asked: its figures on that data say less than they seem to.
- The figures stand in the page in brackets; those of *moving* in `docs/measured/moving_judge.md`, of *follow* and of the odd and even samples in
  `docs/measured/fusion.md`.

"""
DATA = """
## The data

| name | what |
|---|---|
| recording | 7-Scenes redkitchen, 150 frames of a Kinect; *both ways*: played backwards too |
| kitchen A-B | frames A to B of it, taken alone |
| room, stairs, turn, near, corridor | synthetic scenes, `docs/fusion.md`, `docs/recordings.md` |
| moving S, odd / even / first N | samples of `teletact accuracy moving` with seed S (`docs/moving_judge.md`) |
| follow S | seeds from S on of the test `Follow.*` |
| kidnaps S | seed S of `Relocalisation.NeverToTheWrongPlace` |
| bsds500 | 40 training images of BSDS500, `teletact bench table2` |
| mosd_learn, tabletop, ycb_video | touches of `teletact bench segmentation` |
| stability N | hard case N of `teletact stability`: every setting on samples; *fused*: on fields fused from rendered depth (`docs/haptic_rendering.md`) |
| corners | two corners of fused rooms, `docs/haptic_rendering.md`, Cost |
"""


def split(line):
    """Code and comment of a line."""
    at = line.find("//")
    return (line, "") if at < 0 else (line[:at], line[at + 2 :].strip())


def constants(code):
    return [(n, v.strip()) for n, v in CONSTANT.findall(code) if NUMBER.search(v)]


def marks(text, name):
    """Rows (constant, value, chosen, judged) of one file; raises on a mark that is broken or of nothing."""
    rows, lines, mark = [], text.split("\n"), None
    covered = 0

    def close(number):
        if mark is not None and covered == 0:
            raise ValueError(f"{name}:{number}: this mark is of no constant")

    opened, begun = 0, ""
    for number, line in enumerate(lines, 1):
        code, comment = split(line)
        code, begun = begun + code, ""
        if code.rstrip().endswith("="):  # its value is on the next line, and so may the mark be
            begun = code.rstrip() + " "
            continue
        found = MARK.search(comment)
        if "chosen on:" in comment and not found:
            raise ValueError(f"{name}:{number}: a mark is 'chosen on: DATA; judged on: DATA' at the end of one line")
        bare = code.strip()
        if found and bare and not bare.endswith("{"):
            here = constants(code)
            if not here:
                raise ValueError(f"{name}:{number}: this mark is of no constant")
            rows += [(n, v, found["chosen"].strip(), found["judged"]) for n, v in here]
            continue
        if found:
            close(opened)
            mark, covered, opened = found, 0, number
            continue
        if mark is None:
            continue
        if not line.strip() or bare.startswith("}"):
            close(opened)
            mark = None
            continue
        here = [] if re.search(r"\bderived\b|\bno data\b", comment) else constants(code)
        covered += len(here)
        rows += [(n, v, mark["chosen"].strip(), mark["judged"]) for n, v in here]
    close(opened)
    return rows


def page(root):
    files = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard", "--", *FOLDERS],
                           cwd=root, capture_output=True, text=True)
    names = files.stdout.split("\n") if files.returncode == 0 else []
    if not any(names):  # no checkout
        names = [str(p.relative_to(root)) for f in FOLDERS for p in (root / f).rglob("*")]
    out, count = HEAD + "| constant | value | chosen on | judged on | where |\n|---|---|---|---|---|\n", 0
    for name in sorted(n for n in names if n.endswith((".hpp", ".cpp"))):
        if not (root / name).is_file():
            continue
        for constant, value, chosen, judged in marks((root / name).read_text(encoding="utf-8"), name):
            value = re.sub(r"(?<=[\d.])[FU]\b", "", value).replace("|", "\\|")
            out += f"| `{constant}` | {value} | {chosen} | {judged} | `{name}` |\n"
            count += 1
    return out + DATA, count


def self_test():
    text = """struct A {  // chosen on: recording, both ways; judged on: moving 52
  double front_m = 0.018;  // in front
  double map_m = 0.5;  // derived, no key
  int n = 3, m = 4;
};
constexpr double kX = 2.5;  // why; chosen on: room; judged on: nothing else
constexpr double kY = 3;
// chosen on: not recorded; judged on: turn
constexpr std::array<int, 3> kZ{4, 5, 15};
constexpr float kB = 1.5F,  // first
    kC = -2e-3F;

constexpr double kD = 3;
constexpr double kE =
    3e-4;  // of it; chosen on: a; judged on: b
"""
    got = [(n, v) for n, v, _, _ in marks(text, "t")]
    want = [("front_m", "0.018"), ("n", "3"), ("m", "4"), ("kX", "2.5"), ("kZ", "{4, 5, 15}"), ("kB", "1.5F"),
            ("kC", "-2e-3F"), ("kE", "3e-4")]
    assert got == want, got
    assert [r[2] for r in marks(text, "t")][:4] == ["recording, both ways"] * 3 + ["room"]
    for bad in ("int n = 3;  // chosen on: room\n", "// chosen on: a; judged on: b\n\nint n = 3;\n",
                "void f();  // chosen on: a; judged on: b\n"):
        try:
            marks(bad, "bad")
        except ValueError:
            continue
        raise AssertionError(bad)
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        (root / "rt").mkdir()
        (root / "docs").mkdir()
        (root / "rt/a.hpp").write_text(text)
        (root / PAGE).write_text(page(root)[0])
        quiet = lambda text: None
        assert check(root, quiet) == 0
        (root / "rt/a.hpp").write_text(text.replace("0.018", "0.019"))
        assert check(root, quiet) == 1, "a value that changed is not seen"
    print("constants: sees marks, broken ones and a page that is out of date")
    return 0


def check(root, say=print):
    want, count = page(root)
    have = (root / PAGE).read_text(encoding="utf-8") if (root / PAGE).is_file() else ""
    if have == want:
        say(f"{PAGE}: {count} constants, up to date")
        return 0
    say(f"{PAGE} is not what the marks say: run tools/constants.py")
    return 1


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    if sys.argv[1:] == ["--check"]:
        return check(ROOT)
    if sys.argv[1:]:
        print(__doc__, file=sys.stderr)
        return 2
    text, count = page(ROOT)
    (ROOT / PAGE).write_text(text, encoding="utf-8")
    print(f"{PAGE}: {count} constants")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ValueError as e:
        print(f"constants: {e}", file=sys.stderr)
        sys.exit(1)
