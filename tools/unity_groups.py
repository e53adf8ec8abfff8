#!/usr/bin/env python3
"""Which files of a program may be compiled as one: groups in which no own name comes twice.

What tools/check_unity.py forbids in a library is allowed in tests and measurements: two files may
each have a `run()` of their own. So their files are not compiled together as they come but in
groups: a file goes into the first group that has neither one of its own names nor a using
declaration of the same name for something else, and that is not too long. A file that says
`using namespace x;` does not come together with one whose own names some header declares in x.

usage: tools/unity_groups.py TREE...    prints "FILE GROUP" for each .cpp below TREE that does not
                                        stay alone; a group's number counts within its folder
       tools/unity_groups.py --self-test
"""
import collections
import pathlib
import re
import sys

sys.dont_write_bytecode = True
import check_unity  # noqa: E402, behind the line that keeps the tree free of its compiled form
import cpp_shape  # noqa: E402

# Of a group: its compilation is to end before the last ones begin, and to fit into memory.
MOST_LINES = 900
USING = re.compile(r"^using\s+((?:\w+::)+)(\w+)\s*;", re.M)
ALL = ""  # the key of whole names
MACROS = {"TEST", "TEST_F", "TEST_P", "TYPED_TEST", "TYPED_TEST_SUITE",
          "INSTANTIATE_TEST_SUITE_P"}
TESTS = re.compile(r"^(?:TEST|TEST_F|TEST_P|TYPED_TEST)\(\s*(\w+)\s*,\s*(\w+)\s*\)", re.M)


class File:
    def __init__(self, name, text):
        names = check_unity.OwnNames(text)
        self.name, self.lines = name, text.count("\n") + 1
        self.full = set(names.found)
        self.own = {n.rpartition("::")[2] for n in names.found} - MACROS
        self.own |= {f"{suite}_{test}_Test" for suite, test in TESTS.findall(text)}
        self.shared = {n.rpartition("::")[2] for n in names.shared} - MACROS
        self.using = {name: space + name for space, name in USING.findall(text)}
        self.spaces = {s.rpartition("::")[2] for s in names.used}

    def fits(self, other, declared):
        if self.own & (other.own | other.shared) or self.shared & other.own:
            return False
        # A header's name that one of them does not see, and the other brings.
        if (self.full | other.full) & declared[ALL]:
            return False
        for a, b in ((self, other), (other, self)):
            if any(b.using.get(n, target) != target for n, target in a.using.items()):
                return False
            if set(a.using) & b.own:
                return False
            if any(declared[space] & (b.own | set(b.using)) for space in a.spaces):
                return False
        return True


def groups(files, declared):
    """[[File]] of [File]."""
    out = []
    for file in files:
        for group in out:
            if sum(f.lines for f in group) + file.lines <= MOST_LINES and all(
                    file.fits(f, declared) for f in group):
                group.append(file)
                break
        else:
            out.append([file])
    return out


def declared_in_headers(texts):
    """{last part of a namespace: names that headers declare in it}; ALL: all, whole."""
    out = collections.defaultdict(set)
    for text in texts:
        try:
            names = check_unity.OwnNames(text)
        except cpp_shape.Unreadable:
            continue
        for name in names.shared:
            space, _, last = name.rpartition("::")
            out[space.rpartition("::")[2]].add(last)
            if space:
                out[ALL].add(name)
    return out


def self_test():
    def split(*texts, headers=()):
        files = [File(str(i), "namespace {\n" + t + "\n}\n") for i, t in enumerate(texts)]
        return [[f.name for f in g] for g in groups(files, declared_in_headers(headers))]

    header = "namespace a {\nint run();\n}\n"
    wrong = [n for n, (got, want) in enumerate([
        (split("int f() {}", "int g() {}"), [["0", "1"]]),
        (split("int f() {}", "int f() {}", "int g() {}"), [["0", "2"], ["1"]]),
        (split("using a::f;", "using a::f;"), [["0", "1"]]),
        (split("using a::f;", "using b::f;"), [["0"], ["1"]]),
        (split("using a::f;", "int f() {}"), [["0"], ["1"]]),
        (split("TEST(A, B) {}", "TEST(A, B) {}"), [["0"], ["1"]]),
        (split("\n" * MOST_LINES, "int f() {}"), [["0"], ["1"]]),
        (split("using namespace a;", "int run() {}", headers=[header]), [["0"], ["1"]]),
        (split("using namespace a;", "int other() {}", headers=[header]), [["0", "1"]]),
        (split("}\nnamespace a {\nnamespace {\nint run() {}\n}\n", "int f() {}", headers=[header]),
         [["0"], ["1"]]),
    ]) if got != want]
    print(f"self-test: wrong cases: {wrong or 'none'}")
    return 1 if wrong else 0


def main():
    if "--self-test" in sys.argv:
        return self_test()
    root = check_unity.ROOT
    headers = [p.read_text() for top in (*check_unity.TOPS, "tests")
               for p in sorted((root / top).rglob("*.hpp"))]
    declared = declared_in_headers(headers)
    folders = {p.parent for tree in sys.argv[1:] for p in pathlib.Path(tree).rglob("*.cpp")}
    for folder in sorted(folders):
        texts = {p: p.read_text() for p in sorted(folder.glob("*.cpp"))}
        files = [File(p, t) for p, t in texts.items() if not check_unity.MANY_TIMES.search(t)]
        for number, group in enumerate(groups(files, declared)):
            for file in group if len(group) > 1 else []:
                print(file.name, number)
    return 0


if __name__ == "__main__":
    sys.exit(main())
