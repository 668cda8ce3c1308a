"""A header's structs and enums as C declares them: types resolved, sizes of arrays worked out. No layout in bytes."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from pycparser import CParser, c_ast
from pycparser.c_parser import ParseError

from wirebond.generate.from_header.preprocess import Body, Source, stop

MAX_NESTING = 200  # brackets; a header needs ten, and the parser is recursive
MAX_ELEMENTS = 65_535
MAX_LEVELS = 32  # of structs within structs

# What the words of C mean in bytes on a 32-bit ARM, where they agree with a Linux host unless marked.
_SCALARS: dict[str, tuple[str, int]] = {
    **{f"uint{bits}_t": ("u", bits // 8) for bits in (8, 16, 32, 64)},
    **{f"int{bits}_t": ("i", bits // 8) for bits in (8, 16, 32, 64)},
    "char": ("text", 1),
    "signed char": ("i", 1),
    "unsigned char": ("u", 1),
    "short": ("i", 2),
    "unsigned short": ("u", 2),
    "int": ("i", 4),
    "unsigned": ("u", 4),
    "long": ("i", 4),
    "unsigned long": ("u", 4),
    "long long": ("i", 8),
    "unsigned long long": ("u", 8),
    "float": ("f", 4),
    "double": ("f", 8),
    "bool": ("bool", 1),
    "_Bool": ("bool", 1),
    "float32_t": ("f", 4),
    "float64_t": ("f", 8),
}
UNSURE = {
    "long": "4 bytes on a 32-bit MCU, 8 on a 64-bit Linux",
    "unsigned long": "4 bytes on a 32-bit MCU, 8 on Linux",
}
_PRELUDE = "".join(f"typedef int {name};" for name in _SCALARS if name.endswith("_t") or name == "bool")


@dataclass(frozen=True, eq=False)
class Enum:
    name: str
    values: tuple[tuple[str, int], ...]
    size: int  # bytes of a member of this type
    signed: bool


@dataclass(frozen=True)
class Scalar:
    word: str
    kind: str  # its type in a protocol file, of a number without its width: `u`, `text`
    size: int


@dataclass(frozen=True)
class Member:
    """``counts``: sizes of its array dimensions; (0,) is a flexible array at the end."""

    name: str
    type: Scalar | Enum | Struct
    counts: tuple[int, ...]
    line: int


@dataclass(eq=False)
class Struct:
    """``fault`` says why it cannot be described; empty if it can. ``pack``: greatest alignment of a member."""

    name: str
    line: int
    pack: int | None
    members: list[Member] = field(default_factory=list)
    fault: str = ""
    nested: bool = False  # it is a member of another one
    level: int = 1  # structs within structs, itself counted


@dataclass
class Declarations:
    structs: list[Struct]
    enums: list[Enum]
    left_out: list[str]  # sentences on enums that cannot be read


def read_declarations(source: Source, path: Path) -> Declarations:
    """Read the declarations of a header.

    :raises HeaderFileError: the text is not C that the parser can read.
    """
    depth = _nesting(source.text)
    if depth > MAX_NESTING:
        stop(path, 0, f"brackets are nested {depth} deep; {MAX_NESTING} are the most that are read")
    try:
        tree = CParser().parse(_PRELUDE + source.text, str(path))
    except RecursionError:
        stop(path, 0, "a declaration is nested too deeply to be read here; write it in smaller ones")
    except ParseError as error:
        line, what = _place(str(error), path)
        unknown = _unknown_type(source.text)
        if unknown is not None:
            stop(path, unknown[0], f"the type `{unknown[1]}` is not known here; add its typedef to the header")
        stop(path, line, f"this is not C that can be read here ({what}); {_advice(source.text, line)}")
        raise AssertionError("stop raises") from error
    try:
        return _Reader(source, tree).read()
    except RecursionError:  # the parser reads a row of operators in a loop and gives a tree as deep as the row is long
        stop(path, 0, "an expression has too many operators for the importer; write its value as one number")


def _nesting(text: str) -> int:
    depth = deepest = 0
    for character in text:
        depth += (character in "([{") - (character in ")]}")
        deepest = max(deepest, depth)
    return deepest


def _place(message: str, path: Path) -> tuple[int, str]:
    match = re.match(re.escape(str(path)) + r":(\d+)(?::\d+)?: (.*)", message)
    line, what = (int(match[1]), match[2]) if match else (0, message)
    return line, " ".join(what.split())[:80]


def _advice(text: str, line: int) -> str:
    shown = text.split("\n")[line - 1] if 0 < line <= text.count("\n") + 1 else ""
    if re.search(r"\b(class|namespace|template|constexpr|public|private|using)\b|enum\s+\w+\s*:|::", shown):
        return "C++ is not read: give the plain C part of the header"
    return "check brackets and semicolons before this line, or preprocess it first: `cc -E -P`"


def _unknown_type(text: str) -> tuple[int, str] | None:
    """Return line and name of the first member of an undeclared type: the parser's own message does not say it."""
    known = {word for name in _SCALARS for word in name.split()} | {"signed", "const", "volatile"}
    known |= set(re.findall(r"(\w+)\s*(?:\[[^\]]*\]\s*)*;", " ".join(re.findall(r"typedef[^{};]*;", text))))
    known |= set(re.findall(r"}\s*(\w+)\s*;", text))
    if re.search(r"\b(class|namespace|template|public|private|using)\b|::", text):
        return None
    for number, line in enumerate(text.split("\n"), start=1):
        for member in re.finditer(
            r"(?:^|[{;])\s*(?:const\s+|volatile\s+)*([A-Za-z_]\w*)\s+\w+\s*(?:\[[^\]]*\]\s*)*;", line
        ):
            if member[1] not in known and member[1] not in ("struct", "union", "enum", "typedef", "return", "extern"):
                return number, member[1]
    return None


class _Unreadable(Exception):  # noqa: N818  (it ends one struct, and is reported in the result)
    pass


class _Reader:
    def __init__(self, source: Source, tree: c_ast.FileAST) -> None:
        self._source = source
        self._tree = tree
        self._typedefs: dict[str, c_ast.Node] = {}
        self._bodies: dict[int, int] = {}  # id of a struct, union or enum node with a body -> its number
        self._structs: dict[int, Struct] = {}  # by body number
        self._tags: dict[tuple[str, str], c_ast.Node] = {}
        self._enums: dict[int, Enum] = {}
        self._constants: dict[str, int] = {}
        self._left_out: list[str] = []
        self._depth = 0

    def read(self) -> Declarations:
        _Numbering(self._number).visit(self._tree)
        for node in self._tree.ext:
            if isinstance(node, c_ast.Typedef):
                self._typedefs[node.name] = node.type
        for node in self._tree.ext:
            self._declaration(node)
        structs = sorted(self._structs.values(), key=lambda struct: struct.line)
        return Declarations(structs, list(self._enums.values()), self._left_out)

    def _number(self, node: c_ast.Node) -> None:
        self._bodies[id(node)] = len(self._bodies)
        if node.name:
            self._tags[type(node).__name__, node.name] = node

    def _declaration(self, node: c_ast.Node) -> None:
        if not isinstance(node, (c_ast.Typedef, c_ast.Decl)):
            return
        inner = node.type
        while isinstance(inner, (c_ast.TypeDecl, c_ast.ArrayDecl)):
            inner = inner.type
        name = node.name or ""
        if isinstance(inner, c_ast.Struct) and inner.decls is not None:
            self._struct(inner, name if isinstance(node, c_ast.Typedef) else "")
        elif isinstance(inner, c_ast.Enum) and inner.values is not None:
            try:
                self._enum(inner, name if isinstance(node, c_ast.Typedef) else "")
            except _Unreadable as fault:
                self._left_out.append(f"enum {name or inner.name or 'without a name'} is left out: {fault}")

    # ---- enums ----

    def _enum(self, node: c_ast.Enum, name: str) -> Enum:
        number = self._bodies[id(node)]
        if number in self._enums:
            return self._enums[number]
        values = []
        following = 0
        for enumerator in node.values.enumerators:
            if enumerator.value is not None:
                following = self._constant(enumerator.value)
            values.append((enumerator.name, following))
            self._constants[enumerator.name] = following
            following += 1
        numbers = [value for _, value in values]
        signed = min(numbers) < 0
        sizes = (1, 2, 4, 8) if self._body(number).pack == 1 else (4, 8)  # packed takes the smallest that fits
        size = next((s for s in sizes if _fits(min(numbers), max(numbers), s, signed)), None)
        if size is None:
            raise _Unreadable("its values do not fit one integer of 8 bytes")
        enum = Enum(name or node.name or "", tuple(values), size, signed)
        self._enums[number] = enum
        return enum

    def _body(self, number: int) -> Body:
        return self._source.bodies[number]

    # ---- structs ----

    def _struct(self, node: c_ast.Struct, name: str) -> Struct:
        number = self._bodies[id(node)]
        known = self._structs.get(number)
        if known is not None:
            return known
        body = self._body(number)
        struct = Struct(name or node.name or "", body.line, body.pack)
        self._structs[number] = struct
        self._depth += 1
        try:
            if self._depth > MAX_LEVELS:
                raise _Unreadable(f"structs are nested more than {MAX_LEVELS} deep")
            for declared in node.decls or []:
                struct.members.append(self._member(declared, struct))
            for member in struct.members[:-1]:
                if member.counts == (0,):
                    raise _Unreadable(f"{member.name} has no size and is not its last member")
            if not struct.members:
                raise _Unreadable("it has no members")
        except _Unreadable as fault:
            struct.fault = str(fault)
        finally:
            self._depth -= 1
        return struct

    def _member(self, node: c_ast.Node, owner: Struct) -> Member:
        if isinstance(node, c_ast.Pragma) or not isinstance(node, c_ast.Decl):
            raise _Unreadable("it contains something that is not a member")
        name = node.name or ""
        if node.bitsize is not None:
            raise _Unreadable(
                f"{name or 'a member'} is a bit-field, whose layout depends on the compiler; write it as `bits:`"
            )
        counts: list[int] = []
        inner = node.type
        while isinstance(inner, c_ast.ArrayDecl):
            counts.append(0 if inner.dim is None else self._constant(inner.dim))
            inner = inner.type
        if any(count < 0 for count in counts) or _product(counts) > MAX_ELEMENTS:
            raise _Unreadable(f"{name} has {_product(counts)} elements; at most {MAX_ELEMENTS} are possible")
        if counts[1:] and 0 in counts:
            raise _Unreadable(f"{name} has a dimension without a size")
        if isinstance(inner, c_ast.PtrDecl):
            raise _Unreadable(f"{name} is a pointer, which means nothing on the other end")
        if isinstance(inner, c_ast.FuncDecl):
            raise _Unreadable(f"{name} is a function")
        found = self._type(inner, name)
        if isinstance(found, Struct):
            found.nested = True
            if found is owner:
                raise _Unreadable("it contains itself")
            if found.fault:
                raise _Unreadable(f"its member {name} cannot be described: {found.fault}")
            owner.level = max(owner.level, found.level + 1)
            if owner.level > MAX_LEVELS:
                raise _Unreadable(f"structs are nested more than {MAX_LEVELS} deep")
            if 0 in counts or (found.members and found.members[-1].counts == (0,)):
                raise _Unreadable(f"{name} is or contains an array without a size")
        elif counts == [0] and (found.size != 1 or isinstance(found, Enum)):
            raise _Unreadable(f"{name} is an array without a size, which only bytes and characters can have")
        return Member(name, found, tuple(counts), node.coord.line if node.coord else 0)

    def _type(self, node: c_ast.Node, member: str, depth: int = 0) -> Scalar | Enum | Struct:
        if depth > 32:
            raise _Unreadable(f"the type of {member} is defined in terms of itself")
        inner = node.type if isinstance(node, c_ast.TypeDecl) else node
        if isinstance(inner, (c_ast.PtrDecl, c_ast.FuncDecl)):
            raise _Unreadable(f"{member} is a pointer, which means nothing on the other end")
        if isinstance(inner, c_ast.ArrayDecl):
            raise _Unreadable(f"the type of {member} is an array by typedef; write the array out")
        if isinstance(inner, c_ast.Union):
            raise _Unreadable(f"{member or 'a member'} is a union: write one message for each of its meanings")
        if isinstance(inner, (c_ast.Struct, c_ast.Enum)):
            return self._tagged(inner, member)
        words = [word for word in inner.names if word not in ("const", "volatile", "register")]
        name = _canonical(words)
        if name in _SCALARS:
            return Scalar(name, *_SCALARS[name])
        target = self._typedefs.get(name)
        if target is None:
            raise _Unreadable(f"{member} has the type {name}, which is not known here")
        final = target.type if isinstance(target, c_ast.TypeDecl) else target
        if isinstance(final, c_ast.Struct) and final.decls is not None:
            return self._struct(final, name)
        if isinstance(final, c_ast.Enum) and final.values is not None:
            return self._enum(final, name)
        return self._type(target, member, depth + 1)

    def _tagged(self, node: c_ast.Node, member: str) -> Enum | Struct:
        kind = type(node).__name__
        is_body = node.decls is not None if isinstance(node, c_ast.Struct) else node.values is not None
        full = node if is_body else self._tags.get((kind, node.name or ""))
        if full is None:
            raise _Unreadable(f"{member} is of {kind.lower()} {node.name}, which is not defined here")
        if isinstance(full, c_ast.Struct):
            return self._struct(full, "")
        return self._enum(full, "")

    # ---- constants ----

    def _constant(self, node: c_ast.Node) -> int:
        """Calculate a constant.

        :raises _Unreadable: it is more than whole numbers, names of enums and arithmetic.
        """
        if isinstance(node, c_ast.Constant):
            text = node.value.rstrip("uUlL")
            if re.fullmatch("0[xX][0-9a-fA-F]{1,16}|[0-9]{1,20}", text):
                return int(text, 8) if re.fullmatch("0[0-7]+", text) else int(text, 0) if text != "0" * len(text) else 0
            if re.fullmatch("'[ -~]'", node.value):
                return ord(node.value[1])
        elif isinstance(node, c_ast.ID) and node.name in self._constants:
            return self._constants[node.name]
        elif isinstance(node, c_ast.UnaryOp) and node.op in _UNARY:
            return _UNARY[node.op](self._constant(node.expr))
        elif isinstance(node, c_ast.BinaryOp) and node.op in _BINARY:
            left, right = self._constant(node.left), self._constant(node.right)
            if node.op in ("<<", ">>") and not 0 <= right < 64:
                raise _Unreadable(f"a shift by {right} has no meaning")
            if node.op in ("/", "%") and right == 0:
                raise _Unreadable("a size is divided by zero")
            value = _BINARY[node.op](left, right)
            if abs(value) < 1 << 64:
                return value
        elif isinstance(node, c_ast.Cast):
            return self._constant(node.expr)
        raise _Unreadable("the importer cannot calculate a size or value")


_UNARY: dict[str, Callable[[int], int]] = {"-": lambda a: -a, "+": lambda a: a, "~": lambda a: ~a}
_BINARY: dict[str, Callable[[int, int], int]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a // b,
    "%": lambda a, b: a % b,
    "<<": lambda a, b: a << b,
    ">>": lambda a, b: a >> b,
    "|": lambda a, b: a | b,
    "&": lambda a, b: a & b,
    "^": lambda a, b: a ^ b,
}


class _Numbering(c_ast.NodeVisitor):  # type: ignore[misc]
    """Visits bodies in the order of their opening braces, which is how the text before the parser counted them."""

    def __init__(self, number: Callable[[c_ast.Node], None]) -> None:
        self._take = number

    def visit_Struct(self, node: c_ast.Struct) -> None:  # noqa: N802  (the parser's name)
        if node.decls is not None:
            self._take(node)
        self.generic_visit(node)

    def visit_Union(self, node: c_ast.Union) -> None:  # noqa: N802
        self.visit_Struct(node)

    def visit_Enum(self, node: c_ast.Enum) -> None:  # noqa: N802
        if node.values is not None:
            self._take(node)
        self.generic_visit(node)


def _canonical(words: list[str]) -> str:
    """Return the usual name of a type: ``long unsigned int`` and ``unsigned long`` are one."""
    if len(words) == 1 and words[0] not in ("signed", "int", "unsigned"):
        return words[0]
    unsigned = "unsigned" in words
    if "char" in words:
        return "unsigned char" if unsigned else "signed char" if "signed" in words else "char"
    if "double" in words and "long" in words:
        return "long double"
    size = "short" if "short" in words else " ".join(word for word in words if word == "long")
    other = [word for word in words if word not in ("unsigned", "signed", "int", "short", "long")]
    if other:
        return " ".join(words)
    if not size:
        return "unsigned" if unsigned else "int"
    return f"unsigned {size}" if unsigned else size


def _fits(least: int, most: int, size: int, signed: bool) -> bool:
    bits = 8 * size
    return -(1 << (bits - 1)) <= least and most < 1 << (bits - 1) if signed else most < 1 << bits


def _product(counts: list[int]) -> int:
    product = 1
    for count in counts:
        product *= max(count, 1)
    return product
