#!/usr/bin/env python3
"""Seeded mutants: which small errors of the code does the suite see?

    git worktree add --detach /tmp/mutants HEAD
    cmake -S /tmp/mutants --preset release
    tests/mutants/mutants.py /tmp/mutants --out result.json

Each mutant is one operator of one condition or returned value, changed. All are in one build, and
an environment variable chooses the one that runs (mutants.hpp; each changed file includes it).
First each test runs without one and notes which it reaches; a test that fails then judges nothing.
Then each mutant runs through the tests that reach it until one fails: first those that bear the
name of its folder, then the quickest. TREE is changed: a worktree of its own.
"""
import argparse
import concurrent.futures
import json
import os
import random
import re
import subprocess
import sys
import time
from pathlib import Path

ROOMS = ["rt", "perception", "drivers", "tasks", "tools"]
SKIP = ("tools/measure", "tools/console/page", "tools/cmake", "tools/pictures")
SWAPS = [(" <= ", " < "), (" >= ", " > "), (" < ", " <= "), (" > ", " >= "), (" == ", " != "),
         (" != ", " == "), (" && ", " || "), (" || ", " && "), (" + ", " - "), (" - ", " + "),
         (" * ", " / "), (" / ", " * ")]
CONDITION = re.compile(r"^\s*(?:\} else )?if \((.*)\)( \{| return[^;]*;| continue;| break;|$)")
SWITCH = Path(__file__).resolve().with_name("mutants.hpp")
RETURNED = re.compile(r"^\s*return ([^;{}]*);$")


def balanced(text):
    depth = 0
    for c in text:
        depth += (c in "([{") - (c in ")]}")
        if depth < 0:
            return False
    return depth == 0


def mutants_of_line(line):
    """(begin, end, what stands there instead) of each one."""
    found = []
    for pattern in (CONDITION, RETURNED):
        m = pattern.match(line)
        if m and ";" not in m.group(1) and "constexpr" not in line and balanced(m.group(1)):
            found.append(m.span(1))
    for begin, end in found:
        x = line[begin:end]
        # Shifts, templates and lambdas are not read here.
        if "<<" in x or ">>" in x or re.search(r"\w<\w", x) or "?" in x or x.startswith("["):
            continue
        for old, new in SWAPS:
            for m in re.finditer(re.escape(old), x):
                yield begin, end, x[:m.start()] + new + x[m.end():]
        if x.startswith("!") and "&&" not in x and "||" not in x:
            yield begin, end, x[1:]


def possible(tree, room):
    names = subprocess.run(["git", "-C", tree, "ls-files", f"{room}/*.cpp", f"{room}/*.hpp"],
                           capture_output=True, text=True, check=True).stdout.split()
    for name in sorted(n for n in names if not n.startswith(SKIP)):
        for i, line in enumerate((Path(tree) / name).read_text().split("\n")):
            if any(c in line for c in ('"', "'", "//")):
                continue
            for begin, end, new in mutants_of_line(line):
                yield {"room": room, "file": name, "line": i + 1, "begin": begin, "end": end,
                       "to": new}


def choose(tree, seed, rooms, each):
    """One a line; half as many again as are wanted, for some do not compile."""
    rng, chosen = random.Random(seed), []
    for room in rooms:
        all_ = list(possible(tree, room))
        rng.shuffle(all_)
        by_line = {}
        for m in all_:
            by_line.setdefault((m["file"], m["line"]), m)
        chosen += list(by_line.values())[:each + each // 2 + 2]
        print(f"{room}: {len(all_)} possible", flush=True)
    return chosen


def write(tree, mutants, left_out):
    for name in {m["file"] for m in mutants}:
        subprocess.run(["git", "-C", tree, "checkout", "-q", "--", name], check=True)
        lines = (Path(tree) / name).read_text().split("\n")
        for k, m in enumerate(mutants):
            if m["file"] != name or k in left_out:
                continue
            line = lines[m["line"] - 1]
            head, old, tail = line[:m["begin"]], line[m["begin"]:m["end"]], line[m["end"]:]
            lines[m["line"] - 1] = f"{head}teletact_mutant({k}) ? ({m['to']}) : ({old}){tail}"
        # Numbers of lines stay: they are what the compiler's errors name.
        head = f'#include "{SWITCH}"\n#line 1 "{name}"\n'
        (Path(tree) / name).write_text(head + "\n".join(lines))


def build(a, mutants):
    """Numbers of those that do not compile; they are taken back."""
    left_out = set()
    while True:
        write(a.tree, mutants, left_out)
        r = subprocess.run(["ninja", "-C", a.build, "-k", "0", f"-j{a.jobs}", *a.targets],
                           capture_output=True, text=True)
        if r.returncode == 0:
            return left_out
        bad = {k for k, m in enumerate(mutants) if k not in left_out and
               f"{m['file']}:{m['line']}:" in r.stdout}
        if not bad:
            sys.exit(f"the tree does not build:\n{r.stdout[-3000:]}")
        print(f"do not compile: {sorted(bad)}", flush=True)
        left_out |= bad


def ctest(folder, *words, **env):
    return subprocess.run(["ctest", "--test-dir", folder, *words], capture_output=True, text=True,
                          env={**os.environ, **env})


def tests_of(a):
    """Names, and whether each runs alone."""
    listed = json.loads(ctest(a.build, "--show-only=json-v1", "-LE", "stability").stdout)
    for t in listed["tests"]:
        alone = any(p["name"] == "RUN_SERIAL" and p["value"] for p in t.get("properties", []))
        if re.search(a.only, t["name"]):
            yield t["name"], alone


def passes(folder, name, longest_s, **env):
    r = ctest(folder, "-R", f"^{re.escape(name)}$", "--timeout", str(int(longest_s)), **env)
    return r.returncode == 0 and "Not Run" not in r.stdout


def look(a, name, built):
    """A test without a mutant: seconds, and which mutants it reaches; none if it fails."""
    hits = Path(a.build) / "mutant_hits" / name
    hits.parent.mkdir(exist_ok=True)
    began = time.time()
    good = passes(a.build, name, 900, TELETACT_MUTANT_HITS=str(hits))
    took = time.time() - began
    data = hits.read_bytes() if hits.exists() else b""
    reached = {k for k in built if good and k < len(data) and data[k]}
    print(f"{name}: {'passed' if good else 'FAILED, judges nothing'}, {took:.0f} s, "
          f"reaches {len(reached)}", flush=True)
    return name, took, reached


def judge(a, k, mutant, looked):
    folder = mutant["file"].split("/")[1]
    tests = sorted((folder not in name, took, name) for name, took, reached in looked
                   if k in reached)
    by = next((n for other, took, n in tests if not (other and took > a.longest) and
               not passes(a.build, n, 4 * took + 60, TELETACT_MUTANT=str(k))), None)
    verdict = "killed" if by else "survived" if tests else "not reached"
    print(f"{mutant['file']}:{mutant['line']} -> {mutant['to']}: {verdict} {by or ''}", flush=True)
    return {**mutant, "verdict": verdict, "by": by, "tests": len(tests)}


def options():
    p = argparse.ArgumentParser(description=__doc__,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("tree", type=os.path.abspath)
    p.add_argument("--build", type=os.path.abspath, help="default: TREE/build/release")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--count", type=int, default=40, help="of all rooms together")
    p.add_argument("--rooms", nargs="*", default=ROOMS)
    p.add_argument("--targets", nargs="*", default=[], help="of ninja; none: all")
    p.add_argument("--only", default=".", help="the tests whose names have this (regular "
                   "expression)")
    p.add_argument("--longest", type=float, default=float("inf"), help="seconds: a test that takes "
                   "longer judges only mutants of the folder whose name it bears")
    p.add_argument("--jobs", type=int, default=2)
    p.add_argument("--out", required=True, help="JSON of all mutants and what became of them")
    a = p.parse_args()
    a.build = a.build or os.path.join(a.tree, "build/release")
    return a


def main():
    a = options()
    if Path(a.tree) == SWITCH.parents[2]:
        sys.exit(f"{a.tree} is this tree: a worktree of its own is wanted, for TREE is changed")
    # Of a run that was broken off there may be mutants left, with numbers of their own.
    subprocess.run(["git", "-C", a.tree, "checkout", "-q", "--", "."], check=True)
    each = a.count // len(a.rooms)
    mutants = choose(a.tree, a.seed, a.rooms, each)
    left_out = build(a, mutants)
    built = {room: [k for k, m in enumerate(mutants) if m["room"] == room and k not in left_out]
             for room in a.rooms}
    kept = [k for room in a.rooms for k in built[room][:each]]
    every = [k for room in a.rooms for k in built[room]]
    tests = list(tests_of(a))
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        looked = list(pool.map(lambda t: look(a, t[0], every), [t for t in tests if not t[1]]))
    looked += [look(a, name, every) for name, alone in tests if alone]
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        result = list(pool.map(lambda k: judge(a, k, mutants[k], looked), kept))
    Path(a.out).write_text(json.dumps(result, indent=1) + "\n")
    for room in a.rooms:
        verdicts = [r["verdict"] for r in result if r["room"] == room]
        reached = {k for _, _, some in looked for k in some} & set(built[room])
        print(f"{room}: of {len(verdicts)} killed {verdicts.count('killed')}, survived "
              f"{verdicts.count('survived')}, not reached {verdicts.count('not reached')}; "
              f"of {len(built[room])} that were built {len(reached)} reached")


if __name__ == "__main__":
    main()
