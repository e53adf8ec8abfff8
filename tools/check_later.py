#!/usr/bin/env python3
"""Each test that a CMakeLists.txt names apart is there.

teletact_test() has lists of tests that are run alone or not in every run: ALONE_TESTS, WHOLE_TESTS,
LATER_TESTS, LONG_TESTS. GoogleTest takes them as one filter, so a name that fits nothing, say after
a test was given another name, is no error: the test would be run twice, or nowhere.

A pattern is Suite.Name, either of them with `*`, or for parametrised ones
Prefix/Suite.Name/Parameter. It fits where a .cpp of the folder defines such a test; of a parameter,
where one has its name.

usage: tools/check_later.py [--self-test]     exit 1 where there is an offence
"""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
LISTS = ("ALONE_TESTS", "WHOLE_TESTS", "LATER_TESTS", "LONG_TESTS")
CALL = re.compile(r"teletact_test\(([^)]*)\)")
DEFINED = re.compile(r"\bT(?:YPED_T)?EST(?:_[FP])?\(\s*(\w+)\s*,\s*(\w+)\s*\)")


def patterns_of(cmake: str):
    """The patterns of all lists of a CMakeLists.txt."""
    text = re.sub(r"#.*", "", cmake)
    for words in CALL.findall(text):
        wanted = False
        for word in words.split():
            if re.fullmatch(r"[A-Z][A-Z_]+", word):
                wanted = word in LISTS
            elif wanted:
                yield word


def fits(pattern: str, sources: str) -> bool:
    *prefix, rest = pattern.split("/", 1) if re.match(r"[^./]*/", pattern) else [pattern]
    rest, _, parameter = rest.partition("/")
    shape = re.compile(re.escape(rest).replace(r"\*", ".*"))
    if not any(shape.fullmatch(f"{suite}.{name}") for suite, name in DEFINED.findall(sources)):
        return False
    if prefix and not re.search(rf"\bINSTANTIATE_TEST_SUITE_P\(\s*{prefix[0]}\s*,", sources):
        return False
    return parameter in ("", "*") or re.search(rf"\b{re.escape(parameter)}\b", sources) is not None


def self_test():
    cmake = "teletact_test(a COST 3 LATER_TESTS A.One\n  B.* # C.Three\n  DEPS x LABELS y)\n"
    if list(patterns_of(cmake)) != ["A.One", "B.*"]:
        yield f"lists: {list(patterns_of(cmake))}"
    sources = ('TEST(A, One) {}\nTEST_F(B,\n  Two) {}\nTEST_P(C, Three) {}\n'
               'INSTANTIATE_TEST_SUITE_P(All, C, values());\n{"Low", 1}\n')
    for pattern in ("A.One", "B.*", "*.Two", "All/C.Three/Low", "All/C.Three/*"):
        if not fits(pattern, sources):
            yield f"{pattern}: is there"
    for pattern in ("A.Two", "A.On", "D.*", "Some/C.Three/Low", "All/C.Three/High",
                    "All/C.One/Low"):
        if fits(pattern, sources):
            yield f"{pattern}: is not there"


def offences():
    seen = 0
    for cmake in sorted((ROOT / "tests").rglob("CMakeLists.txt")):
        patterns = list(patterns_of(cmake.read_text()))
        if not patterns:
            continue
        sources = "\n".join(p.read_text() for p in sorted(cmake.parent.glob("*.[ch]pp")))
        seen += len(patterns)
        for pattern in patterns:
            if not fits(pattern, sources):
                yield f"{cmake.relative_to(ROOT)}: {pattern} fits no test of its folder"
    if seen == 0:
        yield "no CMakeLists.txt of tests names a test: this check reads them wrongly"
    print(f"tests that are named apart: {seen}")


found = list(self_test() if sys.argv[1:] == ["--self-test"] else offences())
print("\n".join(found), end="\n" if found else "")
sys.exit(1 if found else 0)
