#!/usr/bin/env python3
"""Each source of the program is compiled once, and no object knows when or where it was compiled.

Read are the compile database of a build folder and the sources it names; a source that CMake wrote
counts as the sources that it includes (tools/cmake/compile.cmake). Offences:

- a source of the program (all but tests and tools/measure) that is compiled twice with the same
  flags. Position-independent code for a program or a library is no difference. What is compiled
  again with other flags is listed: a variant for a test or a measurement.
- a macro, or a source that CMake wrote, with the name of the source or build folder in it: a second
  clone could not take the object from the compiler's cache. The two sources that exist to hold
  these names are no offence.
- __DATE__, __TIME__ or __TIMESTAMP__ in a source: the cache is told to overlook them.

usage: tools/check_build.py BUILD_FOLDER
       tools/check_build.py --self-test     exit 1 where there is an offence
"""
import collections
import json
import pathlib
import re
import shlex
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
TOPS = ("rt", "config", "perception", "drivers", "tasks", "tools")
INCLUDE = re.compile(r'^#include "(.+)"$', re.M)
TIME = re.compile(r"\b__(?:DATE|TIME|TIMESTAMP)__\b")
HOLD_PATHS = ("generated/tools/files/source_folder.cpp", "generated/tests/support/paths.cpp")


def flags_of(command):
    """The words that change an object, as one string."""
    words, kept, skip = shlex.split(command), [], False
    for word in words[1:]:
        if skip:
            skip = False
        elif word in ("-o", "-c", "-include"):
            skip = True
        elif not word.startswith(("-W", "-fPI", "-O")) and word != "-Winvalid-pch":
            kept.append(word)
    # With -O: a source at two levels is a variant, too.
    return " ".join(kept + [w for w in words if w.startswith("-O")][-1:])


def parts_of(file, read):
    """The sources that an entry of the database compiles, and what CMake wrote, or None."""
    if "/together/" not in file:
        return [file], None
    text = read(file)
    return INCLUDE.findall(text), text


def judge(entries, read, root, build):
    """(offences, variants) of the database's entries."""
    offences, variants = [], []
    compiled = collections.defaultdict(list)
    for entry in entries:
        file = entry["file"]
        flags = flags_of(entry["command"])
        sources, text = parts_of(file, read)
        if text is None and file.startswith(build + "/") and not file.endswith(HOLD_PATHS):
            text = read(file)
        if text is not None and (root in text or build in text):
            offences.append(f"{file}: names the folder of the source tree or of the build")
        for macro in re.findall(r"-D\S+", entry["command"]):
            if root in macro or build in macro:
                offences.append(f"{file}: the macro {macro} names a folder")
        for source in sources:
            name = source.removeprefix(root + "/")
            if name.split("/")[0] in TOPS and not name.startswith("tools/measure/"):
                compiled[name].append(flags)
    for name, flags in sorted(compiled.items()):
        if len(set(flags)) < len(flags):
            offences.append(
                f"{name}: compiled {len(flags)} times, with {len(set(flags))} sets of flags")
        elif len(flags) > 1:
            variants.append(f"{name}: {len(flags)} variants")
    return sorted(set(offences)), variants


def time_macros(texts):
    return [f"{name}:{text.count(chr(10), 0, found.start()) + 1}: {found.group()}"
            for name, text in texts for found in TIME.finditer(text)]


def self_test():
    def said(entries, texts=None):
        database = [{"file": f, "command": f"g++ {c} -o x.o -c {f}"} for f, c in entries]
        return judge(database, (texts or {}).get, "/tree", "/tree/build")

    twice = [("/tree/rt/a.cpp", "-fPIC -O3"), ("/tree/rt/a.cpp", "-fPIE -Wall -O3")]
    made = "/tree/build/rt/together/rt_1.cpp"
    cases = [
        (said(twice), 1, 0),
        (said([twice[0], ("/tree/rt/a.cpp", "-O3 -DX")]), 0, 1),
        (said([twice[0], ("/tree/rt/a.cpp", "-O1")]), 0, 1),
        (said([("/tree/tools/measure/a.cpp", ""), ("/tree/tools/measure/a.cpp", "")]), 0, 0),
        (said([("/tree/tests/a.cpp", ""), ("/tree/tests/a.cpp", "")]), 0, 0),
        (said([twice[0], (made, "-O3")], {made: '#include "rt/a.cpp"\n'}), 1, 0),
        (said([twice[0], (made, "-O3")], {made: '#include "rt/b.cpp"\n'}), 0, 0),
        (said([(made, "")], {made: '#include "/tree/rt/b.cpp"\n'}), 1, 0),
        (said([("/tree/rt/a.cpp", "-DA=/tree/x")]), 1, 0),
        (said([("/tree/build/x.cpp", "")], {"/tree/build/x.cpp": "/tree/build"}), 1, 0),
        (said([("/tree/build/" + HOLD_PATHS[0], "")]), 0, 0),
    ]
    wrong = [n for n, ((offences, variants), many, others) in enumerate(cases)
             if (len(offences), len(variants)) != (many, others)]
    if len(time_macros([("a", "x\n__TI" + "ME__ __DA" + "TE__"), ("b", "__TIMER__")])) != 2:
        wrong.append("time")
    print(f"self-test: wrong cases: {wrong or 'none'}")
    return 1 if wrong else 0


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    build = pathlib.Path(sys.argv[1]).resolve()
    entries = json.loads((build / "compile_commands.json").read_text())
    offences, variants = judge(entries, lambda f: pathlib.Path(f).read_text(), str(ROOT),
                               str(build))
    sources = [p for top in (*TOPS, "tests") for kind in ("*.cpp", "*.hpp")
               for p in (ROOT / top).rglob(kind) if "node_modules" not in p.parts]
    offences += time_macros((str(p.relative_to(ROOT)), p.read_text()) for p in sources)
    print("\n".join(offences + variants))
    print(f"build: {len(entries)} compilations, {len(variants)} variants, "
          f"{len(offences)} offences")
    return 1 if offences else 0


if __name__ == "__main__":
    sys.exit(main())
