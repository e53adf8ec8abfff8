"""What tools/check_structure.py asks of a C++ file: functions with their lines, classes with their
members.

No compiler: tokens, matching brackets, and how the head of a brace looks. It reads code as
clang-format writes it: the `<` of a template stands next to its name, the `<` of a comparison has
spaces. What it does not see:

- What a macro expands to. A macro without a semicolon in front of a function gives that function
  its name.
- Of #if, #else and #elif: a later branch counts only if the branches before it closed every brace
  that they opened.
- Lambdas inside tables at namespace or class scope. A lambda in a function counts with the
  function; `x = [..] {..}` at namespace or class scope is a function.
- Classes inside functions, and members of base classes. An unnamed struct or union inside a class
  is a class of its own here. Static members and constants do not count.
- Members that a macro declares: `MACRO(x);` looks like a function.
- Members declared with the word struct or enum in front of a type known elsewhere: `struct tm t;`.
"""
import re
from typing import NamedTuple

TOKEN = re.compile(
    r"""(?P<skip>\s+|\\\n|//(?:\\\n|[^\n])*|/\*.*?\*/)
       |(?P<directive>\#(?:\\\n|//[^\n]*|/\*.*?\*/|[^\n])*)
       |(?P<text>(?:u8|[uUL])?(?:R"(?P<fence>[^()\\\s]{0,16})\(.*?\)(?P=fence)"
          |"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])+'))
       |(?P<number>\.?\d(?:[eEpP][+-]|'?[\w.])*)
       |(?P<name>[A-Za-z_]\w*)
       |(?P<mark>::|->\*?|<=>|<=|>=|<<=?|==|!=|&&|\|\||[-+*/%^&|]=|\+\+|--|\.\.\.|.)""",
    re.S | re.X)
CLOSING = {"(": ")", "[": "]", "{": "}"}
NOT_PARAMETERS = {"alignas", "decltype", "noexcept", "explicit", "requires", "__attribute__"}
CLASS = {"class", "struct", "union"}
NO_MEMBER = {"using", "typedef", "friend", "static_assert", "static", "extern", "operator"}
PARAMETERS = {"()", "(*)"}


class Unreadable(Exception):
    """The brackets of a file do not match: then nothing can be said of it."""


class Token(NamedTuple):
    text: str
    line: int
    glued: bool  # nothing between it and the token before


class Function(NamedTuple):
    name: str
    first: int
    last: int


class Class(NamedTuple):
    name: str
    line: int
    members: int


class Branches:
    """Which tokens of #if ... #else ... #endif count."""

    def __init__(self):
        self.open = []  # for each #if: depth of braces there, whether this branch is left out
        self.depth = 0

    def directive(self, word):
        if word.startswith("if"):
            self.open.append([self.depth, False])
        elif word.startswith("el") and self.open:
            self.open[-1][1] = self.open[-1][1] or self.depth != self.open[-1][0]
        elif word == "endif" and self.open:
            self.open.pop()

    def counts(self):
        return not any(left_out for _, left_out in self.open)


def tokens(text):
    """Tokens without comments and preprocessor; a string or character is the token ""."""
    found, branches, line, end = [], Branches(), 1, 0
    for match in TOKEN.finditer(text):
        kind, body = match.lastgroup, match.group()
        if kind == "fence":
            kind = "text"
        if kind == "directive":
            branches.directive((re.match(r"#\s*(\w+)", body) or [body, ""])[1])
        elif kind != "skip" and branches.counts():
            branches.depth += (body == "{") - (body == "}")
            found.append(Token('""' if kind == "text" else body, line, end == match.start()))
        end = -1 if kind == "skip" else match.end()
        line += body.count("\n")
    return found


class Shape:
    """Functions and classes of one file."""

    def __init__(self, text):
        self.tokens = tokens(text)
        self.match = self._brackets()
        self.functions, self.classes = [], []
        at = self._scope(0, [], None)
        if at < len(self.tokens):
            raise Unreadable(f"line {self.tokens[at].line}")

    def _brackets(self):
        match, waiting = {}, []
        for at, token in enumerate(self.tokens):
            if token.text in CLOSING:
                waiting.append(at)
            elif token.text in (")", "]", "}"):
                if not waiting or CLOSING[self.tokens[waiting[-1]].text] != token.text:
                    raise Unreadable(f"line {token.line}")
                match[waiting.pop()] = at
        if waiting:
            raise Unreadable(f"line {self.tokens[waiting[-1]].line}")
        return match

    def _angle(self, at):
        """The `>` that closes the template arguments opened at `at`, or None."""
        depth, here = 0, at
        while here < len(self.tokens):
            text = self.tokens[here].text
            if text in CLOSING:
                here = self.match[here]
            elif text == "<":
                depth += 1
            elif text == ">":
                depth -= 1
                if depth == 0:
                    return here
            elif text in (";", "}", ")"):
                return None
            here += 1
        return None

    def _scope(self, at, names, members):
        """Reads a namespace or a class from `at` to its closing brace. A head is what stands before
        a `{` or `;`, with each group in brackets as one word: () (*) [] <> {}."""
        head, first = [], 0
        while at < len(self.tokens) and self.tokens[at].text != "}":
            text, line, glued = self.tokens[at]
            if not head:
                first = line
            if text == ";":
                self._statement(head, first, members)
                head = []
            elif text == ":" and head and head[-1] in ("public", "protected", "private"):
                head = []
            elif text in ("(", "["):
                pointer = self.tokens[at + 1].text in ("*", "&") and text == "("
                head.append("(*)" if pointer else text + CLOSING[text])
                at = self.match[at]
            elif text == "<" and head and ((glued and is_name(head[-1])) or head[-1] == "template"):
                end = self._angle(at)
                head.append("<>" if end else text)
                at = end or at
            elif text == "{":
                head = self._brace(at, head, first, names)
                at = self.match[at]
            else:
                head.append(text)
            at += 1
        return at

    def _statement(self, head, first, members):
        """A statement of a namespace or, where there are `members`, of a class."""
        if members is not None:
            members.append(data_members(head))

    def _brace(self, at, head, first, names):
        """A `{` behind `head`: goes in, or notes a function; returns what is left of the head."""
        kind, name = kind_of_brace(head)
        end = self.match[at]
        if kind == "namespace":
            self._scope(at + 1, names, None)
            return []
        if kind == "class":
            members = []
            place = len(self.classes)
            self._scope(at + 1, [*names, name], members)
            self.classes.insert(place, Class("::".join([*names, name]), first, sum(members)))
        elif kind in ("function", "lambda"):
            self.functions.append(Function("::".join([*names, name]), first, self.tokens[end].line))
            if kind == "function":
                return []
        return [*head, "{}"]


def is_name(word):
    return (word[0].isalpha() or word[0] == "_") and word != "operator"


def parameters_at(head):
    """Where in the head the parameter list of a function stands, or None."""
    for at, word in enumerate(head):
        if word == "=" and head[at - 1] != "operator":
            return None
        if word in PARAMETERS and at > 0 and head[at - 1] not in NOT_PARAMETERS:
            if word == "()" and head[at - 1] == "operator":
                continue  # operator()
            if word == "(*)" and head[at + 1:at + 2] in (["()"], ["[]"]):
                return None  # a pointer to a function, a reference to an array
            return at
    return None


def function_name(head, at):
    if "operator" in head[:at]:
        begin = head.index("operator")
        name = "operator" + "".join(" " + w if is_name(w) else w for w in head[begin + 1:at])
    else:
        begin, name = at - 1, head[at - 1]
        if name == "<>":  # a specialisation
            begin, name = at - 2, head[at - 2]
        if begin > 0 and head[begin - 1] == "~":
            begin, name = begin - 1, "~" + name
    while begin > 1 and head[begin - 1] == "::":
        begin -= 3 if head[begin - 2] == "<>" else 2
        name = head[begin] + "::" + name
    return name


def kind_of_brace(head):
    """(namespace | class | function | lambda | values, name) of the brace behind this head."""
    words = head[1:] if head[:1] == ["inline"] else head
    if words[:1] == ["namespace"] or words == ["extern", '""']:
        return "namespace", ""
    if head[-1:] == ["requires"] or head[-3:-1] == ["requires", "requires"]:
        return "values", ""
    at = parameters_at(head)
    if at is not None:
        if ":" in head[at:] and (is_name(head[-1]) or head[-1] == "<>"):
            return "values", ""  # a member's initialiser
        return "function", function_name(head, at)
    if "=" in head:
        equals = head.index("=")
        if head[equals + 1:equals + 2] == ["[]"] and equals > 0:
            return "lambda", head[equals - 1]
        return "values", ""
    if "enum" in head:
        return "values", ""
    for at, word in enumerate(head):
        if word in CLASS:
            return "class", class_name(head[at + 1:])
    return "values", ""


def class_name(words):
    name = "(unnamed)"
    for word in words:
        if word in (":", "final"):
            break
        if is_name(word) and word != "alignas":
            name = word
    return name


def data_members(head):
    """How many data members the statement `head;` declares in a class."""
    before = head[:head.index("=")] if "=" in head and "operator" not in head else head
    if not head or any(word in NO_MEMBER for word in before) or parameters_at(head) is not None:
        return 0
    if any(word in CLASS or word == "enum" for word in before):
        # Only what stands behind the braces of a nested class is a member: struct {..} x;
        if "{}" not in before or not any(is_name(word) for word in before[before.index("{}"):]):
            return 0
    return 1 + head.count(",")
