#!/usr/bin/env python3
"""The shipped program holds nothing of what measures it: no source of tools/measure or tests is on
the link line of `teletact`.

Read from build.ninja: the objects of the program, those of every library that it is linked with,
and the source of each. A piece that compiles several sources as one (tools/cmake/compile.cmake)
counts as all of them. So what a library would only pull in if something called it is seen too: the
link map can hold no more than this.

usage: check_link.py BUILD [PROGRAM]     PROGRAM as build.ninja calls it, `teletact` if not given
       check_link.py --self-test BUILD   also: of `teletact-measure` the sources are seen
Exit 1 and one line for each source that may not be there, or if no source of the program is seen.
"""
import pathlib
import re
import sys
import tempfile

NOT_IN = ("tools/measure/", "tests/")
INCLUDED = re.compile(r'^#include "([^"]+)"', re.M)


def words(text):
    """Of a line of build.ninja: $ before a space or a colon makes it part of the word."""
    return [re.sub(r"\$(.)", r"\1", word) for word in re.findall(r"(?:\$.|[^\s$])+", text)]


def edges(text):
    """{output: (rule, what it is made of)}; order-only inputs are left out."""
    found = {}
    for line in re.sub(r"\$\n\s*", " ", text).split("\n"):
        if not line.startswith("build "):
            continue
        made, _, rest = re.sub(r"\$:", "\0", line[6:]).partition(":")
        rule, *inputs = words(rest.replace("\0", "$:"))
        explicit = inputs[:next((i for i, w in enumerate(inputs) if w in ("|", "||")), len(inputs))]
        if "||" in inputs:
            inputs = inputs[:inputs.index("||")]
        compiled = "COMPILER" in rule
        for output in words(made.replace("\0", "$:")):
            found[output] = (rule, explicit if compiled else [w for w in inputs if w != "|"])
    return found


def sources(build, program):
    """Every source whose object is on the program's link line."""
    graph = edges((build / "build.ninja").read_text())
    found, seen, todo = set(), set(), [program]
    while todo:
        at = todo.pop()
        if at in seen or at not in graph:
            continue
        seen.add(at)
        rule, inputs = graph[at]
        if "COMPILER" in rule:
            for source in inputs:
                path = build / source
                unity = "/together/" in source and path.is_file()
                found.update(INCLUDED.findall(path.read_text()) if unity else [source])
        elif "LINKER" in rule or rule == "phony":
            todo += inputs
    return found


def check(root, build, program):
    found = {source.removeprefix(f"{root}/") for source in sources(build, program)}
    wrong = sorted(s for s in found if s.startswith(NOT_IN))
    if not any(s.startswith("tools/") for s in found):
        return [f"{program}: {build}/build.ninja shows no source of tools: nothing was looked at"]
    return [f"{program}: {source} is on its link line" for source in wrong]


def cases():
    """(build.ninja, sources that must be named)"""
    link, ar, cxx = "CXX_EXECUTABLE_LINKER__p", "CXX_STATIC_LIBRARY_LINKER__a", "CXX_COMPILER__a"
    main = f"build m.o: {cxx} /r/tools/teletact/main.cpp\n"
    good = main + f"build l.a: {ar} l.o\nbuild l.o: {cxx} /r/rt/l.cpp || tests/t.o\n"
    yield good + f"build teletact: {link} m.o | l.a || t.o\n  LINK_LIBRARIES = l.a\n", []
    yield main + f"build teletact: {link} m.o b.o\nbuild b.o: {cxx} /r/tools/measure/b.cpp\n", [
        "tools/measure/b.cpp"]
    # Behind two libraries, over a continued line, with escaped marks.
    yield main + (f"build teletact: {link} m.o $\n    | l.a\nbuild l.a: {ar} l.o | k$ k.a\n"
                  f"build k$ k.a | k.so: {ar} k.o\nbuild k.o: {cxx} /r/tests/k.cpp | p.gch\n"
                  f"build l.o: {cxx} /r/rt/l.cpp\n"), ["tests/k.cpp"]
    yield main + f"build teletact: {link} m.o u.o\nbuild u.o: {cxx} a/together/unity_0_cxx.cxx\n", [
        "tools/measure/u.cpp"]
    yield f"build teletact: {link} m.o\n", None
    yield "build other: phony\n", None


def self_test(root, build):
    wrong = 0
    for text, named in cases():
        with tempfile.TemporaryDirectory() as folder:
            here = pathlib.Path(folder)
            (here / "a/together").mkdir(parents=True)
            (here / "a/together/unity_0_cxx.cxx").write_text(
                '#include "/r/rt/a.cpp"\n#include "/r/tools/measure/u.cpp"\n')
            (here / "build.ninja").write_text(text)
            said = check("/r", here, "teletact")
        blind = any("nothing was looked at" in line for line in said)
        names = None if blind else [line.split()[1] for line in said]
        if names != named:
            wrong += 1
            print(f"expected {named}\n    but it said {said}\n    of {text}")
    if not any("tools/measure/main.cpp" in line for line in check(root, build, "teletact-measure")):
        wrong += 1
        print(f"teletact-measure: its own sources are not seen in {build}/build.ninja")
    print(f"self-test: {wrong} cases wrong")
    return 1 if wrong else 0


def main():
    root = str(pathlib.Path(__file__).resolve().parent.parent)
    if sys.argv[1] == "--self-test":
        return self_test(root, pathlib.Path(sys.argv[2]))
    build, program = pathlib.Path(sys.argv[1]), (sys.argv[2:] or ["teletact"])[0]
    wrong = check(root, build, program)
    print("\n".join(wrong) if wrong else
          f"link: {program} is made of {len(sources(build, program))} sources, none of "
          "tools/measure or tests")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
