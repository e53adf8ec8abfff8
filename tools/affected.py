#!/usr/bin/env python3
"""Which tests a change concerns, by what the build itself knows: the headers that each object has
read (ninja -t deps), who is linked with whom (build.ninja), what each test starts (ctest).

usage: tools/affected.py BUILD_FOLDER [--only REGEX] [FILE...]
           FILE: changed files; none: all that differ from HEAD
           REGEX: of these tests only those whose names it fits
       tools/affected.py --self-test
Prints two lines: the targets to build, and the names of the tests, each separated by spaces.

An object that was never built counts as concerned. Checks of the source tree (tests that start no
program of the build) always run. A changed file that no compilation reads and that no test names,
such as a file of config/, concerns every test; docs/ concern the checks alone.
"""
import json
import pathlib
import re
import subprocess
import sys

sys.dont_write_bytecode = True
import check_link  # noqa: E402, behind the line that keeps the tree free of its compiled form

ROOT = pathlib.Path(__file__).resolve().parent.parent
BUILD_FILES = re.compile(
    r"(^|/)CMakeLists\.txt$|\.cmake$|\.in$|CMakePresets\.json$|tools/packages$")


def readers_of(changed, deps):
    """Objects that read one of `changed`; `deps`: the text of `ninja -t deps`, names whole."""
    found, known, at = set(), set(), None
    for line in deps.split("\n"):
        if line and not line[0].isspace():
            at = line.partition(":")[0]
            known.add(at)
        elif line.strip() in changed:
            found.add(at)
    return found, known


def inputs_of(text):
    """{output: its inputs} of build.ninja, order-only ones too: a test may start what it is not
    linked with."""
    edges = {}
    for line in re.sub(r"\$\n\s*", " ", text).split("\n"):
        if line.startswith("build "):
            made, _, rest = re.sub(r"\$:", "\0", line[6:]).partition(":")
            rule, *inputs = check_link.words(rest.replace("\0", "$:"))
            for output in check_link.words(made.replace("\0", "$:")):
                if output != "|":
                    edges[output] = (rule, [w for w in inputs if w not in ("|", "||")])
    return edges


def concerned(edges, roots):
    """All outputs that are made of `roots`."""
    users = {}
    for output, (_, inputs) in edges.items():
        for word in inputs:
            users.setdefault(word, []).append(output)
    found, todo = set(), list(roots)
    while todo:
        at = todo.pop()
        # What only waits for a target before it compiles is not made of it.
        if at in found or at.startswith("cmake_object_order_depends_target_"):
            continue
        found.add(at)
        todo += users.get(at, [])
    return found


def select(edges, deps, tests, changed, root, build, only=""):
    """(targets, names of tests); `changed` relative to the tree, `tests`: [(name, words)]."""
    whole = {f"{root}/{name}" for name in changed}
    near = {"../../" + name for name in changed}  # as ccache names them, from the build folder
    read, known = readers_of(whole | near, deps)
    direct = {o for o, (_, inputs) in edges.items() if whole & set(inputs)}
    compiled = {o for o, (rule, _) in edges.items() if "COMPILER" in rule}
    out = concerned(edges, read | direct | (compiled - known))
    everything = any(BUILD_FILES.search(name) for name in changed)
    seen = {name for name in changed
            if name.startswith("docs/") or f"{root}/{name}" in deps or f"../../{name}" in deps
            or any(f"{root}/{name}" in inputs for _, inputs in edges.values())
            or any(f"{root}/{name}" in word for _, words in tests for word in words)}
    everything = everything or bool(set(changed) - seen)
    programs = {o for o, (rule, _) in edges.items() if "EXECUTABLE_LINKER" in rule}
    names, targets = [], set()
    for name, words in tests:
        if not re.search(only, name):
            continue
        text = " ".join(words)
        started = {p for p in programs
                   if re.search(re.escape(f"{build}/{p}") + r"(?![\w/-])", text)}
        folders = {o for o in out if "/" in o and f"{build}/{o.rpartition('/')[0]}" in words}
        mine = started or any(w.startswith(build) for w in words)
        if everything or not mine or started & out or folders:
            names.append(name)
            targets |= started | folders
    return sorted(targets), names


def ask(*command, folder=ROOT):
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout


def changed_files():
    names = ask("git", "diff", "--name-only", "HEAD") + ask(
        "git", "ls-files", "--others", "--exclude-standard")
    return names.split("\n")[:-1]


def self_test():
    link, cxx = "CXX_EXECUTABLE_LINKER__a", "CXX_COMPILER__a"
    edges = inputs_of(
        f"build a.o: {cxx} /t/rt/a.cpp || cmake_object_order_depends_target_l\n"
        f"build b.o: {cxx} /t/tests/b.cpp || cmake_object_order_depends_target_b\n"
        f"build l.a: AR a.o\nbuild tests/b: {link} b.o | l.a || program\n"
        f"build cmake_object_order_depends_target_c: phony || l.a\n"
        f"build c.o: {cxx} /t/tests/c.cpp || cmake_object_order_depends_target_c\n"
        f"build tests/c: {link} c.o\nbuild page/built: CUSTOM_COMMAND /t/page/x.ts\n")
    deps = ("a.o: #deps 1\n    /t/rt/a.hpp\n    /t/rt/a.cpp\nb.o: #deps 2\n    ../../tests/b.cpp\n"
            "    ../../rt/b.hpp\nc.o: #deps\n    /t/tests/c.cpp\n")
    tests = [("b", ["/t/build/tests/b"]), ("c", ["/t/build/tests/c"]),
             ("p", ["node", "/t/build/page"]), ("check", ["/t/tools/check.py"])]
    every = [name for name, _ in tests]
    wrong = [changed for changed, names in (
        (["rt/a.hpp"], ["b", "check"]), (["rt/b.hpp"], ["b", "check"]),
        (["tests/c.cpp"], ["c", "check"]), (["page/x.ts"], ["p", "check"]),
        (["docs/a.md"], ["check"]), (["config/a.toml"], every),
        (["rt/CMakeLists.txt"], every), (["tools/check.py"], ["check"]),
    ) if select(edges, deps, tests, changed, "/t", "/t/build")[1] != names]
    gone = select(edges, deps.partition("c.o")[0], tests, ["docs/a.md"], "/t", "/t/build")
    if gone != (["tests/c"], ["c", "check"]):
        wrong.append("an object that was never built")
    print(f"self-test: wrong cases: {wrong or 'none'}")
    return 1 if wrong else 0


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    build = pathlib.Path(sys.argv[1]).resolve()
    words = sys.argv[2:]
    only = words[1] if words[:1] == ["--only"] else ""
    words = words[2:] if only else words
    changed = [str((pathlib.Path.cwd() / f).resolve().relative_to(ROOT)) for f in words]
    changed = changed or changed_files()
    listed = json.loads(ask("ctest", "--test-dir", str(build), "--show-only=json-v1"))
    tests = [(t["name"], t.get("command", [])) for t in listed["tests"]]
    deps = ask("ninja", "-C", str(build), "-t", "deps")
    targets, names = select(inputs_of((build / "build.ninja").read_text()), deps, tests, changed,
                            str(ROOT), str(build), only)
    print(" ".join(targets))
    print(" ".join(names))
    return 0


if __name__ == "__main__":
    sys.exit(main())
