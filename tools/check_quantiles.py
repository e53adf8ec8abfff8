#!/usr/bin/env python3
"""One rule for every reported quantile, percentile and median: rt/quantile.hpp.

Looked for in the C++ of rt, config, perception, drivers, tasks, tools and tests, and in the page's
TypeScript. An offence is
  nth_element  std::nth_element or std::partial_sort
  sorted       a sort, and within eight lines below it an index that is a share of a size:
               `[v.size() / 2]`, `v.size() * 95 / 100`, `q * static_cast<double>(v.size())`,
               `Math.ceil(q * v.length)`
  counted      a rank that is compared as a product: `>= q * static_cast<double>(all)`
outside MAY, which says of each file why it stays. A file of MAY without any is an error too. Exit 1
and one line for each offence. `--self-test` proves that offences are seen.
"""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
TOPS = ("rt", "config", "perception", "drivers", "tasks", "tools", "tests")
ENDS = {".hpp", ".cpp", ".inl", ".ts"}
# Who may, and why.
MAY = {
    "rt/quantile.hpp": "the rule itself",
    "tools/console/page/src/wire/quantile.ts": "the same rule for the page",
    "tests/unit/rt_audit_base/histogram_test.cpp": "an oracle, which shares no code",
    "tests/unit/drivers_omega/omega_device_test.cpp": "an oracle, which shares no code",
    "perception/segmentation/object_summary.cpp": "the 0.99 quantile and its mirror image",
    "perception/tsdf/follow/follow_statistics.cpp": "upper median: the lower changes the map",
    "perception/motion/consensus.cpp": "upper median: the lower changes what counts as moving",
    "perception/objects/given_object.cpp": "another rank changes the map",
    "tasks/haptic/surface_left.cpp": "upper median: the lower changes the touch",
}
SORT = re.compile(r"\bsort\(")
OWN = re.compile(r"\b(?:nth_element|partial_sort)\(")
SHARE = re.compile(r"\[[^\]\n]*(?:size\(\)|length) / 2\]|size\(\) \* \d+ / \d+"
                   r"|\b[\w.]+ \* (?:static_cast<double>\()?[\w.>-]*?(?:size\(\)|\.length|\bn\))")
COUNTED = re.compile(r">= \w+ \* static_cast<double>\(\w+\)")
BELOW = 8


def offences(path, text):
    """(line, what) of each."""
    lines = [re.sub(r"//.*", "", line) for line in text.split("\n")]
    last_sort = None
    for number, line in enumerate(lines, 1):
        if OWN.search(line):
            yield number, "nth_element"
        if COUNTED.search(line):
            yield number, "counted"
        if SORT.search(line):
            last_sort = number
        if last_sort and number - last_sort <= BELOW and SHARE.search(line):
            yield number, "sorted"


def check(files, may):
    errors, seen = [], set()
    for path, text in files.items():
        for number, what in offences(path, text):
            seen.add(path)
            if path not in may:
                errors.append(f"{path}:{number}: {what}: a rank of its own; use rt/quantile.hpp")
    return errors + [f"{path}: has no rank of its own any more: remove it from MAY of "
                     "tools/check_quantiles.py" for path in may if path not in seen]


def self_test():
    bad = ["  std::nth_element(a.begin(), at, a.end());", "  std::partial_sort(a, b, c);",
           "  std::sort(v.begin(), v.end());\n  return v[v.size() / 2];",
           "  std::ranges::sort(v);\n\n  return v.at(v.size() * 95 / 100);",
           "  std::sort(a, b);\n  i = static_cast<int>(q * static_cast<double>(v.size()));",
           "  std::sort(a, b);\n  return v[static_cast<int>(q * v.size())];",
           "  const s = [...v].sort(f);\n  return s[Math.ceil(share * s.length) - 1];",
           "  if (static_cast<double>(below) >= q * static_cast<double>(all)) return i;"]
    good = ["  return rt::quantile(v, 0.5);", "  // std::nth_element(a, b, c)",
            "  bytes[bytes.size() / 2] ^= 1;",
            "  std::sort(a, b);\n" + "\n" * 8 + "  x[v.size() / 2];",
            "  std::sort(a, b);\n  return v.front();", "  qsort_like(a);\n  b = 2 * c;"]
    wrong = [f"passed: {text}" for text in bad if not check({"rt/a.cpp": text}, {})]
    wrong += [f"flagged: {text}" for text in good if check({"rt/a.cpp": text}, {})]
    listed = {"rt/a.cpp": "why"}
    wrong += [f"flagged though listed: {text}" for text in bad if check({"rt/a.cpp": text}, listed)]
    if not check({"rt/a.cpp": ""}, listed):
        wrong.append("passed: listed, and has none")
    print("\n".join([*wrong, f"self-test: {len(wrong)} cases wrong"]))
    return 1 if wrong else 0


def main():
    if "--self-test" in sys.argv:
        return self_test()
    files = {str(f.relative_to(ROOT)): f.read_text() for top in TOPS
             for f in sorted((ROOT / top).rglob("*"))
             if f.suffix in ENDS and "node_modules" not in f.parts}
    errors = check(files, MAY)
    print("\n".join(errors) if errors else f"quantiles: one rule in {len(files)} files")
    return 1 if errors else 0


if __name__ == "__main__":
    sys.exit(main())
