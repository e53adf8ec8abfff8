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

HEAD = """# Constants that were chosen on data

`tools/constants.py` writes this page from marks in the source; do not edit it. It lists each
constant that was chosen on data, with the data that chose it and the other data that judged it.
Constants that are derived, defined, or taken from a norm have no mark and are not listed.

- *What it is* comes from the key's description or from the comment beside the constant. *Unit*
  comes from the name; a name without a unit is a number, a share or a count.
- *not recorded*: the source does not say which data chose (or judged) the constant.
- *nothing else*: only the data that chose the constant judged it. So its figures on that data say
  little.
- The page in brackets has the figures. Those of *moving* are in `docs/measured/moving_judge.md`,
  those of *follow* and of odd and even samples in `docs/measured/fusion.md`.

There is one table a room (folder of the source). The last table explains the names of the data.
"""
DATA = """
## The data

| name | what it is |
|---|---|
| recording | 7-Scenes redkitchen, 150 frames of a Kinect; *both ways*: also played backwards |
| kitchen A-B | frames A to B of that recording, used alone |
| room, stairs, turn, near, corridor | synthetic scenes, `docs/fusion.md`, `docs/recordings.md` |
| moving S, odd / even / first N | samples of `teletact accuracy moving` with seed S (`docs/moving_judge.md`) |
| follow S | seeds from S on of the test `Follow.*` |
| kidnaps S | seed S of `Relocalisation.NeverToTheWrongPlace` |
| bsds500 | 40 training images of BSDS500, `teletact bench table2` |
| mosd_learn, tabletop, ycb_video | touches of `teletact bench segmentation` |
| stability N | hard case N of `teletact stability`: every setting on samples; *fused*: on fields fused from rendered depth (`docs/haptic_rendering.md`) |
| corners | two corners of fused rooms, `docs/haptic_rendering.md`, Cost |
"""


# Endings of names that are units, and how they are written.
UNITS = {u: u for u in ("m mm um s ms us N J mJ deg rad Hz kg W voxels frames periods jobs "
                        "share").split()}
UNITS |= {"px": "pixels", "vox": "voxels", "hz": "Hz", "percent": "%", "m2": "m^2", "m3": "m^3",
          "s2": "s^2", "cm2": "cm^2", "mm2": "mm^2"}
KEY = re.compile(r'"(\w+)",\s*[\w.]+(?:\[\d\])?,[^;]*?"((?:[^"\\\n]|"\s*")+)"\s*\)', re.S)


def unit_of(name):
    """The unit in a name: kStep_N_per_s is N/s."""
    parts = re.sub(r"^k(?=[A-Z])", "", name).split("_")
    if len(parts) > 1 and "per" in parts[:-1]:
        at = len(parts) - 1 - parts[::-1].index("per")
        below = "/".join(UNITS.get(p, p) for p in parts[at + 1 :])
        above = UNITS.get(parts[at - 1], "") if at > 0 else ""
        return f"{above or ('m' if below.startswith('m') else '1')}/{below}"  # noise_per_m2: m at 1 m
    last = re.findall(r"[A-Z][a-z]+$", parts[-1])
    if len(parts) == 1 and last:
        counts = ("Frames", "Periods", "Share", "Percent")
        return UNITS[last[0].lower()] if last[0] in counts else ""
    return UNITS.get(parts[-1], "") if len(parts) > 1 else ""


def words(text):
    """A comment as one cell of a table: a line, without marks, at most some 160 characters."""
    text = re.sub(r"(?:\bchosen on:[^;]+;\s*judged on:.*$)|NOLINT\S*", "", text)
    text = re.sub(r"\s+", " ", text).strip(" ;:").replace("|", "\\|")
    if len(text) <= 160:
        return text
    cut = text.rfind(". ", 60, 160)
    return text[: cut + 1] if cut > 0 else text[: text.rfind(" ", 0, 160)] + " ..."


def meanings(text):
    """What a file's comments say of the constants of each line: {line: text}.

    A comment above a group is of all of it.
    """
    said, above, group, open_ = {}, [], "", False
    for number, line in enumerate(text.split("\n"), 1):
        code, comment = split(line)
        comment = words(comment)
        if not line.strip():
            above, group, open_ = [], "", False
        elif not code.strip():
            if open_ and comment and line.index("//") > 8:  # goes on behind code
                said[number - 1] = words(said[number - 1] + " " + comment)
                said[number] = said[number - 1]
            else:
                above.append(comment)
                open_ = False
        else:
            if above:
                group, above = words(" ".join(above)), []
            said[number] = comment or group
            open_ = bool(comment)
    return said


def keys(text):
    """Descriptions of configuration keys in a file: {name: text}."""
    return {n: words(re.sub(r'"\s*"', "", d)) for n, d in KEY.findall(text)}


def split(line):
    """Code and comment of a line."""
    at = line.find("//")
    return (line, "") if at < 0 else (line[:at], line[at + 2 :].strip())


def constants(code):
    return [(n, v.strip()) for n, v in CONSTANT.findall(code) if NUMBER.search(v)]


def marks(text, name):
    """Rows (constant, value, chosen, judged, line) of a file; raises on a broken or useless mark."""
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
            chosen = found["chosen"].strip()
            rows += [(n, v, chosen, found["judged"], number) for n, v in here]
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
        rows += [(n, v, mark["chosen"].strip(), mark["judged"], number) for n, v in here]
    close(opened)
    return rows


def page(root):
    files = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard", "--", *FOLDERS],
                           cwd=root, capture_output=True, text=True)
    names = files.stdout.split("\n") if files.returncode == 0 else []
    if not any(names):  # no checkout
        names = [str(p.relative_to(root)) for f in FOLDERS for p in (root / f).rglob("*")]
    texts = {n: (root / n).read_text(encoding="utf-8") for n in sorted(names)
             if n.endswith((".hpp", ".cpp")) and (root / n).is_file()}
    described = {}  # by room: a key may be described in another file than its value
    for name, text in texts.items():
        described.setdefault(room_of(name), {}).update(keys(text))
    out, count, room = HEAD, 0, None
    for name in sorted(texts, key=lambda n: (room_of(n), n)):
        rows = marks(texts[name], name)
        if rows and room_of(name) != room:
            room = room_of(name)
            out += f"\n## {room}\n\n| constant | what it is | unit | value | "
            out += "chosen on | judged on | file |\n|---|---|---|---|---|---|---|\n"
        said = meanings(texts[name])
        for constant, value, chosen, judged, line in rows:
            value = re.sub(r"(?<=[\d.])[FU]\b", "", value).replace("|", "\\|")
            what = described[room].get(constant) or said.get(line, "")
            file = name[len(room) + 1 :]
            out += f"| `{constant}` | {what} | {unit_of(constant)} | {value} | "
            out += f"{chosen} | {judged} | `{file}` |\n"
            count += 1
    return out + DATA, count


def room_of(name):
    """perception/tsdf of perception/tsdf/blocks/block_pool.hpp."""
    return "/".join(name.split("/")[: -1][:2])


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
    got = [(n, v) for n, v, *_ in marks(text, "t")]
    want = [("front_m", "0.018"), ("n", "3"), ("m", "4"), ("kX", "2.5"), ("kZ", "{4, 5, 15}"), ("kB", "1.5F"),
            ("kC", "-2e-3F"), ("kE", "3e-4")]
    assert got == want, got
    assert [r[2] for r in marks(text, "t")][:4] == ["recording, both ways"] * 3 + ["room"]
    said = meanings(text)
    assert [said[r[4]] for r in marks(text, "t")][:4] == ["in front", "", "", "why"], said
    key = 's.number("front_m", front_m, 0.0, 1.0,\n  "before the "\n  "map");'
    assert keys(key) == {"front_m": "before the map"}
    units = {"kStep_N_per_s": "N/s", "front_m": "m", "noise_per_m2": "m/m^2", "kX": "",
             "least_share": "share", "kDoubtFrames": "frames"}
    assert {n: unit_of(n) for n in units} == units
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
