#!/usr/bin/env python3
"""The structure of the source tree has limits, and what is beyond them today may only shrink.

What is judged, in rt, config, perception, drivers, tasks and tools (tests are not):

    cycle      no folders that include each other in a circle. A folder is what holds the file; an
               #include of a file of another folder is an arrow. The number is that of the arrows
               inside the circle.
    file       at most 450 lines
    function   at most 60 lines, from the first word of its head to its closing brace
    folder     at most 40 files of C++ or TypeScript, those of folders inside it not counted
    members    at most 35 data members in a class
    columns    no line of more than 100 columns; lines with a URL or an #include do not count. The
               number is that of the lines.
    duplicate  no 120 tokens of two files the same, as sim_c++ of the package similarity-tester sees
               it: all names and numbers are the same to it, all strings too; it leaves out
               comments, includes and semicolons. The number is the sum of all such runs of the two.

Files are .hpp, .cpp and .inl. Of TypeScript (.ts) lines, columns, folders and functions are judged,
the latter by their indentation; of scripts (.py, .sh, .mjs and what begins with #!) and .css only
lines and columns. Folders node_modules are not ours. How functions and classes of C++ are found,
and what is not seen, is said in tools/cpp_shape.py. sim_c++ takes the text of a raw string for code
and breaks a number at a ', both only within a line or so.

What is beyond a limit today stands in tools/structure_exceptions.txt, a line each: `KIND PLACE
NUMBER`, and behind it `permanent: REASON` where it is to stay. A number above that of its line is
an offence. A number below it, or a place that is within the limit, is an error too, until the line
is lowered or removed: so the list shrinks with the code. A permanent line may say `any` for its
number: a table grows a row at a time, and one row more needs no change of the list. No option
writes the list: the first line of an error is what it would say.

usage: tools/check_structure.py [--self-test]     exit 1 where there is an error
"""
import collections
import pathlib
import re
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True
import cpp_shape  # noqa: E402, behind the line that keeps the tree free of its compiled form

ROOT = pathlib.Path(__file__).resolve().parent.parent
TOPS = ("rt", "config", "perception", "drivers", "tasks", "tools")
LIST = "tools/structure_exceptions.txt"
CPP = (".hpp", ".cpp", ".inl")
SCRIPTS = (".py", ".sh", ".mjs", ".css")
TS_HEAD = re.compile(r"^( *)(?:(?:export|async|private|static|override|get|set|function) )*"
                     r"(?!if\b|for\b|while\b|switch\b|catch\b)(\w+)(?:<[^>(]*>)?\(")
COLUMNS = 100
RUN = 120
# Of each kind: what is allowed, and of what.
LIMITS = {
    "cycle": (0, "arrows in a circle of folders"),
    "file": (450, "lines"),
    "function": (60, "lines"),
    "folder": (40, "files"),
    "members": (35, "data members"),
    "columns": (0, f"lines of more than {COLUMNS} columns"),
    "duplicate": (0, f"tokens in runs of {RUN} or more that another file has too"),
}
INCLUDE = re.compile(r'^\s*#\s*include "([^"]+)"', re.M)
RUN_LINE = re.compile(r"^(\S+): line [\d-]+\s*\|(\S+): line [\d-]+\s*\[(\d+)\]", re.M)
ANY = float("inf")
FORM = "`KIND PLACE NUMBER` or `KIND PLACE NUMBER permanent: REASON`"
ENTRY = re.compile(r"(\w+) (\S.*?) (\d+|any(?= permanent:))(?: permanent: (\S.*))?")


def folder_of(path):
    return path.rpartition("/")[0]


# These take {path: text} and give {place: number}.

def files(sources):
    return {path: len(text.splitlines()) for path, text in sources.items()}


def folders(sources):
    return collections.Counter(folder_of(path) for path in sources
                               if path.endswith((*CPP, ".ts")))


def columns(sources):
    return {path: sum(len(line) > COLUMNS and "://" not in line and not INCLUDE.match(line)
                      for line in text.splitlines()) for path, text in sources.items()}


def ts_functions(text):
    """(name, lines) of each function: from the line of the name to the brace at its indent."""
    lines = text.splitlines()
    for first, line in enumerate(lines):
        head = TS_HEAD.match(line)
        opened = next((at for at in range(first, min(first + 8, len(lines)))
                       if lines[at].endswith(("{", ";", "}"))), None) if head else None
        if opened is None or not lines[opened].endswith("{") or lines[opened].endswith("=> {"):
            continue
        end = next((at for at in range(opened + 1, len(lines))
                    if lines[at].startswith(head[1] + "}")), len(lines) - 1)
        yield head[2], end - first + 1


def shapes(sources):
    """Lines of functions, members of classes, files that can not be read. Of several with one name
    in a file the second is NAME~2."""
    lines, members, unreadable = {}, {}, []
    for path, text in sources.items():
        if path.endswith(".ts"):
            for name, number in ts_functions(text):
                place = f"{path} {name}"
                lines[place] = max(lines.get(place, 0), number)
        if not path.endswith(CPP):
            continue
        try:
            shape = cpp_shape.Shape(text)
        except cpp_shape.Unreadable as error:
            unreadable.append(f"{path}: brackets do not match, {error}")
            continue
        for found, said in ((lines, [(f.name, f.last - f.first + 1) for f in shape.functions]),
                            (members, [(c.name, c.members) for c in shape.classes])):
            times = collections.Counter()
            for name, number in said:
                times[name] += 1
                again = f"~{times[name]}" if times[name] > 1 else ""
                found[f"{path} {name}{again}"] = number
    return lines, members, unreadable


def arrows(sources):
    """{folder: {folder it includes of: one such include}}"""
    found = collections.defaultdict(dict)
    for path, text in sources.items():
        for included in INCLUDE.findall(text) if path.endswith(CPP) else ():
            here, there = folder_of(path), folder_of(included)
            if included in sources and here != there:
                found[here].setdefault(there, f"{path} includes {included}")
    return found


def cycles(sources):
    """{folders of a circle: arrows inside it}, and for each circle one include for each arrow."""
    graph = arrows(sources)
    reach = {}
    for start in list(graph):
        seen, todo = set(), [start]
        while todo:
            for there in graph.get(todo.pop(), ()):
                if there not in seen:
                    seen.add(there)
                    todo.append(there)
        reach[start] = seen
    numbers, why = {}, {}
    for start in sorted(reach):
        if start not in reach[start]:
            continue
        circle = sorted(other for other in reach[start] if start in reach.get(other, ()))
        inside = [graph[a][b] for a in circle for b in sorted(graph[a]) if b in circle]
        numbers[" ".join(circle)], why[" ".join(circle)] = len(inside), inside
    return numbers, why


def duplicates(sources, root):
    """What sim_c++ finds: each pair of files alone (-e), no file with itself (-s)."""
    paths = sorted(path for path in sources if path.endswith(CPP))
    if not paths:
        return {}
    said = subprocess.run(["sim_c++", "-e", "-s", "-n", "-T", "-r", str(RUN), "-i"], cwd=root,
                          input="".join(path + "\n" for path in paths), text=True,
                          capture_output=True, check=True)
    found = collections.Counter()
    for one, other, tokens in RUN_LINE.findall(said.stdout):
        found[" ".join(sorted((one, other)))] += int(tokens)
    return found


def measure(sources, root):
    """{(kind, place): number} of what is beyond the limits, {(kind, place): lines that say why},
    and errors of no place in the list."""
    lines, members, errors = shapes(sources)
    circles, why = cycles(sources)
    of_kind = {"cycle": circles, "file": files(sources), "function": lines, "members": members,
               "folder": folders(sources), "columns": columns(sources)}
    try:
        of_kind["duplicate"] = duplicates(sources, root)
    except FileNotFoundError:
        errors.append("duplicate: there is no sim_c++: apt-get install similarity-tester")
    beyond = {(kind, place): number for kind, places in of_kind.items()
              for place, number in places.items() if number > LIMITS[kind][0]}
    return beyond, {("cycle", place): reasons for place, reasons in why.items()}, errors


def read_list(text):
    """({(kind, place): (number, words behind it)}, errors)"""
    listed, errors = {}, []
    for at, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        match = ENTRY.fullmatch(line.rstrip())
        if not match or match[1] not in LIMITS:
            errors.append(f"{LIST}:{at}: not {FORM}: {line}")
        elif (match[1], match[2]) in listed:
            errors.append(f"{LIST}:{at}: twice: {line}")
        else:
            words = f" permanent: {match[4]}" if match[4] else ""
            number = ANY if match[3] == "any" else int(match[3])
            listed[match[1], match[2]] = (number, words)
    return listed, errors


def left_of(place, number, listed):
    """Is this circle what is left of a larger one in the list?"""
    return any(kind == "cycle" and set(place.split()) < set(other.split()) and number < allowed
               for (kind, other), (allowed, _) in listed.items())


def judge(beyond, listed, why):
    """Errors: the line as it would stand in the list, and below it what is wrong."""
    errors = []
    for (kind, place), number in sorted(beyond.items()):
        limit, of_what = LIMITS[kind]
        allowed, words = listed.get((kind, place), (limit, ""))
        line = f"{kind} {place} {number}{words}"
        if kind == "cycle" and left_of(place, number, listed):
            errors.append(f"{line}\n    left of a listed circle: put this line in its place")
        elif number > allowed:
            listed_too = ", as listed" if (kind, place) in listed else ""
            reasons = "".join(f"\n    {reason}" for reason in why.get((kind, place), ()))
            errors.append(f"{line}\n    {of_what}: at most {allowed}{listed_too}{reasons}")
        elif number < allowed != ANY:
            errors.append(f"{line}\n    {of_what}: {LIST} allows {allowed}: lower its line to this")
    for (kind, place), (number, words) in sorted(listed.items()):
        if (kind, place) not in beyond:
            said = "any" if number == ANY else number
            errors.append(f"{kind} {place} {said}{words}\n    within the limit now, or gone: "
                          f"remove this line from {LIST}")
    return errors


def check(sources, root, list_text):
    beyond, why, errors = measure(sources, root)
    listed, unread = read_list(list_text)
    if not any(error.startswith("duplicate:") for error in errors):
        return errors + unread + judge(beyond, listed, why)
    known = {key: value for key, value in listed.items() if key[0] != "duplicate"}
    return errors + unread + judge(beyond, known, why)


def is_script(path):
    if path.suffix or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(2) == b"#!"


def read_sources(root):
    return {str(path.relative_to(root)): path.read_text()
            for top in TOPS for path in sorted((root / top).rglob("*"))
            if "node_modules" not in path.parts
            and (path.suffix in (*CPP, ".ts", *SCRIPTS) or is_script(path))}


# The self-test: cases of {path: text}, the list, and the errors expected, whole or first lines.

def function(lines, head="int f() {"):
    return head + "\n" + "  g();\n" * (lines - 2) + "}\n"


def record(members, extra=""):
    return "struct S {\n" + extra + "".join(f"  int a{k}_ = 0;\n" for k in range(members)) + "};\n"


def varied(count, name):
    """`count` statements of six tokens that count, none like another."""
    marks = "+-*/%&|^"
    return "".join(f"{name} = {name}{k} {marks[k % 8]} {marks[k // 8]}{k};\n" for k in range(count))


def size_cases():
    yield {"rt/a/a.hpp": "//\n" * 450}, []
    yield {"rt/a/a.hpp": "//\n" * 451, "tests/a.hpp": "//\n" * 451}, ["file rt/a/a.hpp 451"]
    forty = {f"rt/a/{k}.hpp": "" for k in range(40)}
    yield {**forty, "rt/a/b/a.hpp": "", "rt/a/CMakeLists.txt": "", "rt/a/a.py": ""}, []
    yield {**forty, "rt/a/a.cpp": ""}, ["folder rt/a 41"]
    yield {**{f"rt/a/{k}.ts": "" for k in range(41)}}, ["folder rt/a 41"]
    yield {"rt/a/a.ts": "//\n" * 451}, ["file rt/a/a.ts 451"]
    free = f"// http://x.org/{'x' * 90}\n#include \"{'x' * 99}\"\n"
    yield {"rt/a.hpp": f"//{'─' * 98}\n" + free}, []
    yield {"rt/a.hpp": f"//{'x' * 99}\n\n//{'x' * 99}"}, ["columns rt/a.hpp 2"]
    script, text = "#" + "x" * 100, "x" * 101
    yield {"tools/t": f"#!/bin/sh\n{script}", "tools/t.py": script, "tools/t.txt": text}, \
        ["columns tools/t 1", "columns tools/t.py 1"]


def function_cases():
    def of(text, *functions):
        return {"rt/a.cpp": text}, [f"function rt/a.cpp {line}" for line in functions]

    yield of(function(60))
    yield of(function(61), "f 61")
    trailing = function(61, "auto A<T>::f(int x) const -> std::vector<B> {")
    yield of("namespace n {\nnamespace {\n" + trailing + "}\n}\n", "A::f 61")
    call = function(61, "bool operator()(Options o = {}) const {")
    yield of("class A : B {\n public:\n" + call + "};", "A::operator() 61")
    yield of(function(61, "A::A(int x) : B<T>{x}, x_{x}, y_(x) {") + function(61, "A::~A() {"),
             "A::A 61", "A::~A 61")
    yield of(function(9) + function(61, "int f(int) {"), "f~2 61")
    yield {"rt/a.ts": function(61, "export async function g(): Promise<void> {")}, [
        "function rt/a.ts g 61"]
    method = function(61, "  private f<T>(a: T,\n    b: T): void {").replace("\n}", "\n  }")
    yield {"rt/a.ts": "class A {\n" + method + "}\n"}, ["function rt/a.ts f 62"]
    yield {"rt/a.ts": function(61, "call(() => {") + function(61, "if (a) {")}, []
    yield {"rt/a.ts": function(60, "function h() {")}, []
    yield of("template <class T>\n  requires(sizeof(T) < 9)\n" + function(59), "f 61")
    yield of(function(61, "int f() { call([&](int a) {").replace("\n}", "\n}); }"), "f 61")
    yield of(function(61, "const auto f = [](int a) {") + ";", "f 61")
    # Braces in texts and comments are none, and a table is no function.
    text = function(4, """int f() { g(1'000, '{', '\\'', "{", R"x({ )" )x"); // {\n/* { */""")
    yield of(text + "constexpr T k[] = {\n" + "  {1, f(2)},\n" * 70 + "};\n" + text)
    rows = "  row<A, B>({1, f(2)}, R{3}),\n" * 70
    yield of("inline constexpr std::tuple k{\n" + rows + "  row(4)};\n")
    # One body with two heads.
    yield of("#if X\nint f() {\n#else\nint g() {\n#endif\n" + "\n" * 60 + "}\n", "f 65")
    yield {"rt/a.cpp": "int f() {\n"}, ["rt/a.cpp: brackets do not match, line 1"]
    yield {"rt/a.cpp": "int f() {}\n}\n"}, ["rt/a.cpp: brackets do not match, line 2"]


def member_cases():
    none = """  using T = int;
  static constexpr int kA = 1;
  enum class E { kA, kB };
  struct Inner { int x; };
  S() = default;
  ~S();
  S& operator=(const S&) = default;
  bool operator<(const S& o) const { return a < o.a; }
  [[nodiscard]] std::array<int, 3> size(int a, int b) const noexcept;
  template <class T> void f();
  friend B;
 private:
"""
    six = """  std::map<int, std::pair<int, int>> map_{{1, {2, 3}}};
  void (*call)(int, int) = nullptr;
  int a : 3, b : 4;
  alignas(64) std::atomic<int> at_{0};
  struct { int x; } inner_;
"""
    yield {"rt/a.hpp": record(35, none)}, []
    yield {"rt/a.hpp": record(29, six)}, []
    yield {"rt/a.hpp": record(36)}, ["members rt/a.hpp S 36"]
    inside = "namespace n {\nstruct O {\n" + record(30, six + none) + "};\n}"
    yield {"rt/a.hpp": inside}, ["members rt/a.hpp O::S 36"]


def relation_cases():
    def tree(**included):
        return {f"rt/{one}/{one}.hpp": "".join(f'#include "{other}"\n' for other in others)
                for one, others in included.items()}

    a, b, c, test = "rt/a/a.hpp", "rt/b/b.hpp", "rt/c/c.hpp", "tests/t.hpp"
    yield {**tree(a=[b], b=[c], c=[test]), test: f'#include "{a}"\n'}, []
    # The circle is of folders, not of files; files of one folder make none.
    yield {**tree(a=[b], b=["rt/a/x.hpp"]), "rt/a/x.hpp": ""}, ["cycle rt/a rt/b 2"]
    yield tree(a=[b], b=[c], c=[a]), ["cycle rt/a rt/b rt/c 3"]
    yield {**tree(a=["rt/a/x.hpp"]), "rt/a/x.hpp": f'#include "{a}"\n'}, []
    yield {"rt/a.cpp": varied(20, "x"), "tasks/b.cpp": varied(20, "y")}, []
    yield {"rt/a.cpp": varied(25, "x") * 2}, []
    yield {"rt/a.cpp": varied(25, "x"), "tests/b.cpp": varied(25, "x")}, []
    yield {"rt/a.cpp": "int a;\n" + varied(21, "x"), "tasks/b.cpp": "//\n" + varied(21, "y")}, \
        ["duplicate rt/a.cpp tasks/b.cpp 125"]


def list_cases():
    long = {"rt/a.hpp": "//\n" * 460}
    yield long, "# why\n\nfile rt/a.hpp 460\n", []
    yield long, "file rt/a.hpp 460 permanent: a table\n", []
    yield long, "file rt/a.hpp 459\n", ["file rt/a.hpp 460"]
    yield long, "file rt/a.hpp 461 permanent: table\n", ["file rt/a.hpp 460 permanent: table"]
    yield long, "file rt/a.hpp any permanent: a table\n", []
    yield {}, "file rt/a.hpp any permanent: a table\n", ["file rt/a.hpp any permanent: a table"]
    yield long, "file rt/a.hpp 460\nfile rt/gone.hpp 500\n", ["file rt/gone.hpp 500"]
    yield {"rt/a.hpp": "//\n" * 450}, "file rt/a.hpp 460\n", ["file rt/a.hpp 460"]
    for line in ("file rt/a.hpp", "files rt/a.hpp 460", "file rt/a.hpp 460 permanent:",
                 "file rt/a.hpp 460 for ever", "file rt/a.hpp any"):
        yield {}, line, [f"{LIST}:1: not {FORM}: {line}"]
    yield long, "file rt/a.hpp 460\nfile rt/a.hpp 460\n", [f"{LIST}:2: twice: file rt/a.hpp 460"]
    to_a, to_b = '#include "rt/a/a.hpp"\n', '#include "rt/b/b.hpp"\n'
    yield {"rt/a/a.hpp": to_b, "rt/b/b.hpp": to_a}, "cycle rt/a rt/b 2\n", []
    yield {"rt/a/a.hpp": to_b, "rt/b/b.hpp": ""}, "cycle rt/a rt/b 2\n", ["cycle rt/a rt/b 2"]
    yield {"rt/a/a.hpp": to_b, "rt/b/b.hpp": to_a}, "cycle rt/a rt/b rt/c 3\n", [
        "cycle rt/a rt/b 2\n    left of a listed circle: put this line in its place",
        f"cycle rt/a rt/b rt/c 3\n    within the limit now, or gone: remove this line from {LIST}"]
    yield {"rt/a/a.hpp": to_b, "rt/b/b.hpp": to_a}, "cycle rt/a rt/b rt/c 2\n", [
        "cycle rt/a rt/b 2\n    arrows in a circle of folders: at most 0"
        "\n    rt/a/a.hpp includes rt/b/b.hpp\n    rt/b/b.hpp includes rt/a/a.hpp",
        f"cycle rt/a rt/b rt/c 2\n    within the limit now, or gone: remove this line from {LIST}"]


def self_test():
    groups = (size_cases, function_cases, member_cases, relation_cases)
    cases = [(sources, "", expected) for group in groups for sources, expected in group()]
    cases += list_cases()
    wrong = 0
    for sources, listed, expected in cases:
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for path, text in sources.items():
                (root / path).parent.mkdir(parents=True, exist_ok=True)
                (root / path).write_text(text)
            said = check(read_sources(root), root, listed)
        if not any("\n" in error for error in expected):
            said = [error.split("\n")[0] for error in said]
        if said != expected:
            wrong += 1
            print(f"expected {expected}\n    but it said {said}\n    of {str(sources)[:200]}\n"
                  f"    listed {listed!r}")
    print(f"self-test: {wrong} of {len(cases)} cases wrong")
    return 1 if wrong else 0


def main():
    if "--self-test" in sys.argv:
        return self_test()
    sources = read_sources(ROOT)
    errors = check(sources, ROOT, (ROOT / LIST).read_text())
    print("\n".join(errors) or f"structure: {len(sources)} files within the limits or as listed")
    return 1 if errors else 0


if __name__ == "__main__":
    sys.exit(main())
