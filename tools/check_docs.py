#!/usr/bin/env python3
"""What the pages name is there: files, functions, commands and their options.

Looked at: README.md, CONTRIBUTING.md and docs/*.md, what stands in `code` or in a code block, and
links. An offence is
  file      a path below a folder of the tree, or a source's bare name, that no file has
  link      a link to a file that is not there
  function  `name()` that no source calls or defines; `Type::name` whose name no source has;
            `path`: `name()` or `path`, `name()` where neither that file nor the one beside it of
            the same stem has the name
  command   `teletact NAME` that tools/teletact/main.cpp does not list
  option    behind a command or a script of tools/, an option that no source of tools/ has
Words with < > or in capitals stand for something and are left out. Pages in `docs/measured` tell of
what was and are left out too; of them an offence is
  measured  no "Command:", "Commit:" or "Machine:" before the first figures. What is unknown is "not
            recorded"
Exit 1 and one line for each offence. `--self-test` proves that
offences are seen.
"""
import fnmatch
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
TOPS = ("rt", "config", "perception", "drivers", "tasks", "tools", "tests", "docs")
SOURCE = re.compile(r"^[\w*.-]+\.(hpp|cpp|inl|py|ts|mjs|cmake)$")
PAIR = re.compile(r"`([\w/.-]+\.(?:cpp|hpp|ts))`[:,]\s+`(?:\w+::)?(\w+)\(\)`")
COMMANDS = "tools/teletact/main.cpp"
# Written by a build or a run; not of this tree.
NOT_HERE = re.compile(r"^(build|report|raw|config/local)\b")


def spans(text):
    """(line number, code) of each `code` and each line of a code block."""
    block = False
    for number, line in enumerate(text.split("\n"), 1):
        if line.lstrip().startswith("```"):
            block = not block
        elif block or (line.startswith("    ") and "`" not in line):  # else a list goes on
            yield number, re.sub(r"\s#\s.*", "", line.strip())
        else:
            for code in re.findall(r"`([^`]+)`", line):
                yield number, code


def alternatives(word):
    """a.{hpp,cpp} is two files."""
    found = re.search(r"\{([^{}]*,[^{}]*)\}", word)
    if not found:
        return [word]
    begin, end = word[:found.start()], word[found.end():]
    return [w for part in found[1].split(",") for w in alternatives(begin + part + end)]


class Tree:
    def __init__(self, files):
        self.files = set(files)
        self.texts = files
        self.folders = {str(p) for f in files for p in pathlib.PurePosixPath(f).parents}
        self.names = {f.rsplit("/", 1)[-1] for f in files}
        # Without this file: its self-test names what is not there.
        code = [text for f, text in files.items() if f.split("/")[0] in TOPS
                and not f.endswith(".md") and f != "tools/check_docs.py"]
        self.words = set(re.findall(r"\w+", "\n".join(code)))
        self.called = set(re.findall(r"(\w+)\s*(?:<[^;{}()]*>)?\(", "\n".join(code)))
        self.commands = set(re.findall(r'Command\{"(\w+)"', files.get(COMMANDS, "")))
        tools = [text for f, text in files.items() if f.startswith("tools/")
                 and f != "tools/check_docs.py"]
        self.options = set(re.findall(r"--[a-z][\w-]*", "\n".join(tools)))

    def has(self, path):
        path = path.rstrip("/")
        if "*" in path:
            return bool(fnmatch.filter(self.files, path))
        if path in self.files or path in self.folders:
            return True
        # A folder of scenes or faults is said with the name alone, a test by its folder's files.
        return any(f.startswith(path + ".") for f in self.files)

    def wrong_word(self, word):
        word = word.strip(".,:;()").removeprefix("./")
        if not word or re.search(r"[<>$%=]|\b[A-Z]{2,}\b|\.\.\.", word) or NOT_HERE.match(word):
            return None
        for one in alternatives(word):
            if "/" in one and one.split("/")[0] in TOPS and re.match(r"^[\w./*{},-]+$", one):
                if not self.has(one):
                    return "file", one
            elif SOURCE.match(one) and not fnmatch.filter(self.names, one):
                return "file", one
            elif re.match(r"^[\w/-]+/[\w-]+\.(hpp|cpp|ts)$", one):
                if not any(f.endswith("/" + one) or f == one for f in self.files):
                    return "file", one
        return None

    def wrong_name(self, code):
        for name in re.findall(r"(?:\w+::)*(\w+)\(\)", code):
            if name not in self.called:
                return "function", name + "()"
        for name in re.findall(r"\b[A-Z]\w*::(\w+)\b(?!\()", code):
            if name not in self.words:
                return "function", name
        return None

    def wrong_pair(self, path, name):
        stems = {f.rsplit(".", 1)[0] for f in self.files if f == path or f.endswith("/" + path)}
        texts = [self.texts[f] for f in self.files if f.rsplit(".", 1)[0] in stems]
        return bool(texts) and not any(re.search(rf"\b{name}\b", text) for text in texts)

    def wrong_command(self, code):
        for run in re.split(r"[|;&]|\s{3,}", code):
            words = run.split()
            words = words[1:] if words[:1] == ["sudo"] else words
            if not words:
                continue
            program = words[0].rsplit("/", 1)[-1]
            ours = words[0].startswith("tools/") or program in ("teletact", "teletact-measure")
            if not ours:
                continue
            if program == "teletact" and len(words) > 1 and re.match(r"^[a-z]+$", words[1]):
                if words[1] not in self.commands:
                    return "command", f"teletact {words[1]}"
            for option in re.findall(r"(?<!\S)\[?(--[a-z][\w-]*)", run):
                if option not in self.options and option not in ("--help", "--version"):
                    return "option", f"{program} {option}"
        return None


def offences(page, text, tree):
    for number, code in spans(text):
        found = [tree.wrong_word(word) for word in code.split()]
        found += [tree.wrong_name(code), tree.wrong_command(code)]
        yield from (f"{page}:{number}: {kind}: {what}" for kind, what in filter(None, found))
    for path, name in PAIR.findall(text):
        if tree.wrong_pair(path, name):
            yield f"{page}: function: {name}() is not in {path}"
    base = pathlib.PurePosixPath(page).parent
    for number, line in enumerate(text.split("\n"), 1):
        for link in re.findall(r"\]\(([^)#\s]+)", line):
            place = str(base / link)
            if ":" not in link and not tree.has(place):
                yield f"{page}:{number}: link: {link}"


def unknown_origin(page, text):
    """What a page of figures does not say of how they were measured."""
    head = "\n".join(text.split("\n")[:12])
    for word in ("Command:", "Commit:", "Machine:"):
        if not re.search(rf"{word}\s+\S", head):
            yield f"{page}: measured: it does not say its {word[:-1].lower()}"


def self_test():
    tree = Tree({
        "rt/time.hpp": "Time now();\nstruct Clock { int step_ns; };", "docs/a.md": "",
        "config/scenes/room.toml": "", "tools/run": "--rights)", COMMANDS: 'Command{"demo", f}',
        "tools/teletact/cmd_demo.cpp": 'app.add_option("--seconds")'})
    good = ["`rt/time.hpp`, `time.hpp`, `rt/{time,time}.hpp`, `rt/*.hpp`, `rt/`",
            "`config/scenes/room`", "`now()` and `Clock::step_ns`", "`time.hpp`: `now()`",
            "    teletact demo --seconds 3  # or --more", "[a](a.md)",
            "`teletact COMMAND --help`, `tools/run --rights`", "`rt/<name>.hpp`",
            "`other --option`", "`teletact/cmd_demo.cpp`",
            "no code: rt/gone.hpp", "`build/release/teletact demo`"]
    bad = ["`rt/gone.hpp`", "`gone.hpp`", "`rt/{time,gone}.hpp`", "`rt/*.cpp`", "`later()`",
           "`sub/time.hpp`", "    so (`rt/gone.hpp`)",
           "`Clock::later`", "`Clock::later()`", "    teletact dance",
           "`teletact demo --minutes 3`",
           "`tools/run --wrongs`", "`rt/time.hpp`: `add_option()`",
           "`time.hpp`,\n  `add_option()`", "[a](b.md)", "`build/release/teletact dance`"]
    wrong = [("passed", t) for t in bad if not list(offences("docs/p.md", t, tree))]
    wrong += [(o, t) for t in good for o in offences("docs/p.md", t, tree)]
    origin = "# Measured\n\nCommand: `a`. Commit: not recorded.\nMachine: b.\n"
    wrong += [(o, origin) for o in unknown_origin("docs/measured/a.md", origin)]
    wrong += [("passed", w) for w in ("Command:", "Commit:", "Machine:")
              if len(list(unknown_origin("docs/measured/a.md", origin.replace(w, "")))) != 1]
    for what, text in wrong:
        print(f"{what}: {text}")
    print(f"self-test: {len(wrong)} of {len(good) + len(bad) + 4} cases wrong")
    return 1 if wrong else 0


def main():
    if "--self-test" in sys.argv:
        return self_test()
    git = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(git, cwd=ROOT, capture_output=True, text=True, check=False).stdout
    listed = listed.split("\n")
    if len(listed) < 2:  # no repository: an unpacked archive
        listed = [str(p.relative_to(ROOT)) for p in ROOT.rglob("*") if "build" not in p.parts]
    files = {f: (ROOT / f).read_text(errors="replace") for f in listed if (ROOT / f).is_file()}
    tree = Tree(files)
    pages = [f for f in files if re.match(r"^(README|CONTRIBUTING|docs/\w+)\.md$", f)]
    found = [wrong for page in sorted(pages) for wrong in offences(page, files[page], tree)]
    found += [wrong for f in sorted(files) if re.match(r"^docs/measured/\w+\.md$", f)
              for wrong in unknown_origin(f, files[f])]
    print("\n".join(found) if found else f"docs: {len(pages)} pages name what is there")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
