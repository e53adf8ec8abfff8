#!/usr/bin/env python3
"""No two files of a library give a name of their own the same name.

A release build compiles several files of a library as one (TELETACT_UNITY). Which of them come
together depends on their number, so two files that each define `kMost` in an unnamed namespace may
compile today and not tomorrow, when a file is added beside them.

A name of a file's own is one that it declares in an unnamed namespace, or `static` or as a lambda
in a namespace: variables, functions, types, aliases. Two such names are the same if their named
namespaces are too. Two functions of one name are an offence even where their parameters differ: a
call would choose between both. A header with an unnamed namespace counts as a file. Where a .cpp
says `using namespace x;`, what headers of its library declare in x is no other file's own name.
Not seen: enumerators of an enum without class, names that a macro makes, headers of other
libraries, and what tools/cpp_shape.py does not see.

A library is what one folder holds, and the folders in it that PARTS of its CMakeLists.txt names.
Folders below one whose CMakeLists.txt says `GROUPS` come together otherwise
(tools/unity_groups.py). A file with SKIP_UNITY_BUILD_INCLUSION, or one that Highway compiles for
several instruction sets, stays alone.

usage: tools/check_unity.py [--self-test]     exit 1 where there is an offence
"""
import collections
import pathlib
import re
import sys

sys.dont_write_bytecode = True
import cpp_shape  # noqa: E402, behind the line that keeps the tree free of its compiled form

ROOT = pathlib.Path(__file__).resolve().parent.parent
TOPS = ("rt", "config", "perception", "drivers", "tasks", "tools")
LIBRARY = re.compile(r"teletact_library\([^)]*?FOLDER\s+(\S+)\s+PARTS\s+([^)A-Z]*)")
ALONE = re.compile(r"set_source_files_properties\(([^)]*?)PROPERTIES\s[^)]*SKIP_UNITY_BUILD")
MANY_TIMES = re.compile(r'HWY_TARGET_INCLUDE|include "hwy/|vectors-inl\.hpp')


class OwnNames(cpp_shape.Shape):
    """{name with its namespaces: line} of what only this file sees, `found`, and of the others,
    `shared`; and the namespaces that it uses whole."""

    def __init__(self, text):
        self.space, self.found, self.shared, self.used = [], {}, {}, set()
        super().__init__(text)

    def _statement(self, head, first, members):
        if members is None:
            if head[:2] == ["using", "namespace"]:
                self.used.add(head[-1])
            for name in declared(head):
                self._note(name, head, first)
        super()._statement(head, first, members)

    def _brace(self, at, head, first, names):
        kind, name = cpp_shape.kind_of_brace(head)
        if kind == "namespace":
            self.space.append("".join(head).rpartition("namespace")[2])
        elif not names and kind in ("class", "function", "lambda"):
            self._note(name, ["static"] if kind == "lambda" else head, first)
        left = super()._brace(at, head, first, names)
        if kind == "namespace":
            self.space.pop()
        return left

    def _note(self, name, head, first):
        if "::" in name or name.startswith("operator") or name == "(unnamed)":
            return
        own = "" in self.space or "static" in head
        names = self.found if own else self.shared
        names.setdefault("::".join([*filter(None, self.space), name]), first)


def declared(head):
    """The names that a statement in a namespace declares, `head` as cpp_shape has it."""
    if head[:1] == ["using"]:
        return [head[1]] if head[2:3] == ["="] else []
    if not head or head[0] in ("namespace", "friend", "static_assert", "extern"):
        return []
    if cpp_shape.parameters_at(head) is not None:
        return [cpp_shape.function_name(head, cpp_shape.parameters_at(head))]
    if "enum" in head:
        return [word for word in head[head.index("enum") + 1:] if word not in cpp_shape.CLASS][:1]
    if cpp_shape.CLASS & set(head) and "{}" in head:
        head = head[head.index("{}") + 1:]  # a class; behind it what it is the type of
    names, before, reading = [], [], True
    for word in [*head, ","]:
        if word == ",":
            names += [w for w in before if cpp_shape.is_name(w)][-1:]
            before, reading = [], True
        elif word in ("=", "{}", "[]"):
            reading = False
        elif reading:
            before.append(word)
    return names


def libraries(texts):
    """{.cpp: its library} of {path: text}: the .cpp that may be compiled with others."""
    parts, alone, apart = {}, set(), set()
    for path, text in texts.items():
        folder, _, name = path.rpartition("/")
        if name != "CMakeLists.txt":
            continue
        for inside, words in LIBRARY.findall(text):
            whole = f"{folder}/{inside}"
            parts.update({f"{whole}/{part}": whole for part in words.split()})
        for words in ALONE.findall(text):
            alone.update(f"{folder}/{word}" for word in words.split())
        if " GROUPS" in text:
            apart.add(folder + "/")
    return {path: parts.get(folder, folder) for path, text in texts.items()
            for folder in [path.rpartition("/")[0]]
            if path.endswith(".hpp") or path.endswith(".cpp") and path not in alone
            and not MANY_TIMES.search(text)
            if not any(path.startswith(start) for start in apart)}


def offences(texts):
    own, shared, used = (collections.defaultdict(list) for _ in range(3))
    errors = []
    for path, library in sorted(libraries(texts).items()):
        try:
            names = OwnNames(texts[path])
        except cpp_shape.Unreadable as error:
            errors.append(f"{path}: brackets do not match, {error}")
            continue
        for name, line in names.found.items():
            own[library, name].append(f"{path}:{line}")
        if path.endswith(".hpp"):
            for name, line in names.shared.items():
                shared[library, *name.split("::")[-2:]].append(f"{path}:{line}")
        else:
            used[library] += sorted(names.used)
    for (library, name), places in sorted(own.items()):
        for space in dict.fromkeys(used[library]):
            places += shared.get((library, space, name.rpartition("::")[2]), [])
        if len(places) > 1:
            errors.append(f"{name}: own name of {places[0]}, name of {', '.join(places[1:])} too")
    return errors


def read_tree(root):
    return {str(path.relative_to(root)): path.read_text() for top in TOPS
            for path in sorted((root / top).rglob("*"))
            if path.suffix in (".cpp", ".hpp") or path.name == "CMakeLists.txt"}


# The self-test: {path: text}, and how each offence begins.

def unnamed(text, space="teletact"):
    return f"namespace {space} {{\nnamespace {{\n{text}\n}}\n}}\n"


def cases():
    def pair(one, other, *expected):
        return {"rt/a/a.cpp": one, "rt/a/b.cpp": other}, list(expected)

    most = unnamed("constexpr int kMost = 3;")
    yield pair(most, unnamed("constexpr int kLeast = 3;"))
    yield pair(most, unnamed("constexpr float kFew[] = {1}, kMost{2};"), "teletact::kMost: ")
    yield pair(most, unnamed("struct kMost {\n  int a;\n} const x;"), "teletact::kMost: ")
    yield pair(most, unnamed("struct A : kMost {\n  int kMost = 1;\n};"))
    yield pair(most, unnamed("enum class kMost { a };"), "teletact::kMost: ")
    yield pair(most, unnamed("constexpr int kMost = 3;", "tasks"))
    yield pair(most, "namespace teletact {\nint kMost() { return 3; }\n}\n")
    yield pair(most, "namespace teletact {\nstatic int kMost() {}\n}\n", "teletact::kMost: ")
    yield pair(unnamed("int f(int) {\n  int g = 1;\n}"),
               unnamed("int g(int);\nA B::h() {}\ntemplate <class T>\nint f(T t) noexcept {}"),
               "teletact::f: ")
    yield pair(unnamed("int f() {}\nint f();\nint f(int) {}"), unnamed("int A::f() {}"))
    yield pair(unnamed("const auto f = [](int a) {};"), unnamed("using f = int;"), "teletact::f: ")
    yield pair("namespace {\nint a;\n", "", "rt/a/a.cpp: brackets do not match")
    # Which files come together.
    yield {"rt/a/a.cpp": most, "rt/b/a.cpp": most}, []
    parts = "teletact_library(x FOLDER a PARTS b c\n  DEPS d)\n"
    tree = {"rt/CMakeLists.txt": parts, "rt/a/a.cpp": most, "rt/a/c/b.cpp": most,
            "rt/a/d/c.cpp": most}
    yield tree, ["teletact::kMost: own name of rt/a/a.cpp:3, name of rt/a/c/b.cpp:3 too"]
    alone = "set_source_files_properties(a/b.cpp PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)\n"
    yield {"rt/CMakeLists.txt": alone, **pair(most, most)[0]}, []
    yield {"rt/CMakeLists.txt": "teletact_compile(a GROUPS)", **pair(most, most)[0]}, []
    yield pair(most, '#include "hwy/highway.h"\n' + most)
    # Headers.
    yield {"rt/a/a.cpp": most, "rt/a/a-inl.hpp": most}, ["teletact::kMost: "]
    named = {"rt/a/a.hpp": "namespace teletact::x {\ninline constexpr int kMost = 1;\n}\n"}
    yield {"rt/a/a.cpp": most, **named}, []
    yield {"rt/a/a.cpp": most, "rt/a/b.cpp": "using namespace x;\n", **named}, ["teletact::kMost: "]


def self_test():
    wrong = 0
    for number, (texts, expected) in enumerate(cases()):
        said = offences(texts)
        if len(said) != len(expected) or any(not s.startswith(e) for s, e in zip(said, expected)):
            wrong += 1
            print(f"case {number}: expected {expected}, but it said {said}\n    of {texts}")
    print(f"self-test: {wrong} of {number + 1} cases wrong")
    return 1 if wrong else 0


def main():
    if "--self-test" in sys.argv:
        return self_test()
    texts = read_tree(ROOT)
    found = offences(texts)
    print("\n".join(found) or f"unity: {len(libraries(texts))} files, each own name once")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
