#!/usr/bin/env python3
"""Private headers stay inside their library.

A header of rt, config, perception, drivers or tasks is public and installed, unless the
`teletact_library(... PRIVATE ...)` of its folder names it. Then it is not installed, and

    only files below the folder of its library, and tests, may include it;
    no public header may include it: a consumer would not find it.

What PRIVATE names must be there, and be named once.

usage: tools/check_headers.py [--self-test]     exit 1 where there is an offence
"""
import pathlib
import posixpath
import re
import sys

sys.dont_write_bytecode = True
ROOT = pathlib.Path(__file__).resolve().parent.parent
INSTALLED = ("rt", "config", "perception", "drivers", "tasks")
INCLUDE = re.compile(r'^\s*#\s*include "([^"]+)"', re.M)
LIBRARY = re.compile(r"teletact_library\(([^)]*)\)")
KEYWORDS = {"FOLDER", "PARTS", "DEPS", "PACKAGES", "PRIVATE"}


def private_headers(texts):
    """({header: folder of its library}, errors)"""
    found, errors = {}, []
    for top in INSTALLED:
        path = f"{top}/CMakeLists.txt"
        for words in LIBRARY.findall(texts.get(path, "")):
            said = {}
            for word in words.split():
                if word in KEYWORDS:
                    said[word] = values = []
                elif said:
                    values.append(word)
            for name in said.get("PRIVATE", ()):
                folder = posixpath.normpath(f"{top}/{said['FOLDER'][0]}")
                header = f"{folder}/{name}"
                if header not in texts:
                    errors.append(f"{path}: PRIVATE names {header}, which is not there")
                if header in found:
                    errors.append(f"{path}: PRIVATE names {header} twice")
                found[header] = folder
    return found, errors


def offences(texts):
    private, errors = private_headers(texts)
    for path, text in sorted(texts.items()):
        for included in INCLUDE.findall(text):
            if included not in private or path.startswith("tests/"):
                continue
            if not path.startswith(private[included] + "/"):
                errors.append(f"{path}: {included} is private to {private[included]}")
            elif path.endswith(".hpp") and path not in private:
                errors.append(f"{path}: it is public and includes {included}, which is private")
    return errors


def read_tree(root):
    return {str(path.relative_to(root)): path.read_text() for top in (*INSTALLED, "tools")
            for path in sorted((root / top).rglob("*"))
            if path.suffix in (".hpp", ".cpp") or path.name == "CMakeLists.txt"}


def cases():
    def tree(library="PRIVATE in.hpp", **texts):
        cmake = f"teletact_library(rt_a FOLDER a DEPS b\n  {library})\n"
        cmake += "teletact_library(rt_b FOLDER b)\n"
        return {"rt/CMakeLists.txt": cmake, "rt/a/in.hpp": "", **texts}

    of_it = '#include "rt/a/in.hpp"\n'
    yield tree(**{"rt/a/a.cpp": of_it, "rt/a/part/a.cpp": of_it, "tests/a.hpp": of_it}), []
    yield tree("", **{"rt/b/b.hpp": of_it}), []
    yield tree(**{"tools/host/a.cpp": of_it}), ["tools/host/a.cpp: rt/a/in.hpp is private to rt/a"]
    yield tree(**{"rt/b/b.cpp": of_it}), ["rt/b/b.cpp: rt/a/in.hpp is private to rt/a"]
    yield tree(**{"rt/ab/b.cpp": of_it}), ["rt/ab/b.cpp: rt/a/in.hpp is private to rt/a"]
    yield tree(**{"rt/a/out.hpp": of_it}), [
        "rt/a/out.hpp: it is public and includes rt/a/in.hpp, which is private"]
    yield tree("PRIVATE in.hpp out.hpp", **{"rt/a/out.hpp": of_it}), []
    yield tree("PRIVATE in.hpp gone.hpp PACKAGES x"), [
        "rt/CMakeLists.txt: PRIVATE names rt/a/gone.hpp, which is not there"]
    yield tree("PRIVATE in.hpp in.hpp"), ["rt/CMakeLists.txt: PRIVATE names rt/a/in.hpp twice"]
    whole = {"config/CMakeLists.txt": "teletact_library(config FOLDER . PRIVATE in.hpp)",
             "config/in.hpp": "", "tasks/a/a.cpp": '#include "config/in.hpp"'}
    yield whole, ["tasks/a/a.cpp: config/in.hpp is private to config"]


def self_test():
    wrong = 0
    for number, (texts, expected) in enumerate(cases(), 1):
        said = offences(texts)
        if said != expected:
            wrong += 1
            print(f"case {number}: expected {expected}, but it said {said}")
    print(f"self-test: {wrong} of {number} cases wrong")
    return 1 if wrong else 0


def main():
    if "--self-test" in sys.argv:
        return self_test()
    texts = read_tree(ROOT)
    found = offences(texts)
    print("\n".join(found) or f"headers: {len(private_headers(texts)[0])} private ones stay inside")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
