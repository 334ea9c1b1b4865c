"""The mutants of a source file, by mutmut's operators, each as a changed text with a class."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import libcst as cst
from libcst.metadata import MetadataWrapper, PositionProvider, WhitespaceInclusivePositionProvider
from mutmut.mutation.file_mutation import (
    NEVER_MUTATE_FUNCTION_NAMES,
    MutationVisitor,
    OuterFunctionProvider,
)
from mutmut.mutation.mutators import mutation_operators
from mutmut.mutation.pragma_handling import IgnoredCode

from mutation.mutant import COMPARISON, OTHER, Mutant

COMPARES = (cst.ComparisonTarget, cst.BaseCompOp)
"""Nodes whose mutation changes <, <=, >, >=, ==, !=, in, not in, is or is not."""
_NO_BEHAVIOUR = re.compile(r"__all__|[A-Z]\w*[a-z]\w*")
"""Names at the level of a module: what it exports, and aliases of types."""


def mutants(root: Path, path: Path) -> list[Mutant]:
    """All mutants of a file that are not left out by the rules in `_Collector._left_out`."""
    text = path.read_text(encoding="utf-8")
    wrapper = MetadataWrapper(cst.parse_module(text))
    collector = _Collector(wrapper.module)
    wrapper.visit(collector)
    found: dict[str, Mutant] = {}
    for function, kind, source in collector.found:
        try:
            ast.parse(source)
        except SyntaxError:
            continue  # the interpreter refuses it, so no test needs to
        first, last, before, after = _changed_lines(text, source)
        mutant = Mutant(
            str(path.relative_to(root)), function, kind, (first, last), before, after, source
        )
        found.setdefault(mutant.id, mutant)
    return list(found.values())


class _Collector(MutationVisitor):
    """Walks a module as mutmut does, but also into decorated functions."""

    METADATA_DEPENDENCIES = (
        PositionProvider,
        OuterFunctionProvider,
        WhitespaceInclusivePositionProvider,
    )

    def __init__(self, module: cst.Module) -> None:
        super().__init__(mutation_operators, IgnoredCode(set(), set(), set()))
        self.module = module
        self.code = module.code
        self.starts = [0]
        for line in self.code.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.scope: list[cst.CSTNode] = []
        self.text_for_people = 0
        self.found: list[tuple[str, str, str]] = []

    def on_visit(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.FunctionDef | cst.ClassDef):
            self.scope.append(node)
        if isinstance(node, cst.Raise):
            self.text_for_people += 1
        return super().on_visit(node)

    def on_leave(self, original_node: cst.CSTNode) -> None:
        super().on_leave(original_node)
        if isinstance(original_node, cst.FunctionDef | cst.ClassDef):
            self.scope.pop()
        if isinstance(original_node, cst.Raise):
            self.text_for_people -= 1

    def _skip_node_and_children(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.FunctionDef) and node.name.value not in NEVER_MUTATE_FUNCTION_NAMES:
            return False
        if isinstance(node, cst.Assign) and not self.scope and _assigns(node, _NO_BEHAVIOUR):
            return True
        return super()._skip_node_and_children(node)

    def _create_mutations(self, node: cst.CSTNode) -> None:
        for node_type, operator in self._operators:
            if isinstance(node, node_type):
                for mutated in operator(node):
                    if not self._left_out(node, mutated):
                        kind = COMPARISON if isinstance(node, COMPARES) else OTHER
                        function = ".".join(scope.name.value for scope in self.scope)
                        self.found.append((function, kind, self._spliced(node, mutated)))

    def _left_out(self, node: cst.CSTNode, mutated: cst.CSTNode) -> bool:
        """What is not mutated, by policy (see docs/mutation.md)."""
        if self.text_for_people:
            return True
        if isinstance(node, cst.SimpleString):
            # Texts for people have spaces; a name or a key is mutated once, not in three ways.
            return " " in node.value or '"XX' not in mutated.value
        if isinstance(node, cst.Call) and isinstance(mutated, cst.Call):
            return _strict(node) != _strict(mutated)
        return bool(isinstance(node, cst.Name) and id(node) in self._asserted)

    @property
    def _asserted(self) -> set[int]:
        """The names `True` in `strict=True`: an assertion on the code itself, not behaviour."""
        if not hasattr(self, "_asserted_names"):
            finder = _StrictFinder()
            self.module.visit(finder)
            self._asserted_names = finder.found
        return self._asserted_names

    def _spliced(self, node: cst.CSTNode, mutated: cst.CSTNode) -> str:
        span = self.get_metadata(WhitespaceInclusivePositionProvider, node, None)
        code = self.code
        if span is not None:
            begin = self.starts[span.start.line - 1] + span.start.column
            end = self.starts[span.end.line - 1] + span.end.column
            if code[begin:end] == self.module.code_for_node(node):
                return code[:begin] + self.module.code_for_node(mutated) + code[end:]
        replaced = self.module.deep_replace(node, mutated)
        assert isinstance(replaced, cst.Module)
        return replaced.code


class _StrictFinder(cst.CSTVisitor):
    def __init__(self) -> None:
        self.found: set[int] = set()

    def visit_Arg(self, node: cst.Arg) -> None:
        if node.keyword is not None and node.keyword.value == "strict":
            self.found.add(id(node.value))


def _strict(call: cst.Call) -> str:
    return "".join(
        cst.Module([]).code_for_node(arg.value)
        for arg in call.args
        if arg.keyword is not None and arg.keyword.value == "strict"
    )


def _assigns(node: cst.Assign, names: re.Pattern[str]) -> bool:
    return any(
        isinstance(t.target, cst.Name) and names.fullmatch(t.target.value) for t in node.targets
    )


def _changed_lines(old: str, new: str) -> tuple[int, int, str, str]:
    """First and last changed line of the old text, and both texts' changed lines in one line."""
    a, b = old.splitlines(), new.splitlines()
    head = sum(1 for _ in _common(iter(a), iter(b)))
    tail = sum(1 for _ in _common(reversed(a[head:]), reversed(b[head:])))
    before, after = a[head : len(a) - tail], b[head : len(b) - tail]
    return head + 1, max(head + 1, len(a) - tail), _joined(before), _joined(after)


def _common(a: Iterator[str], b: Iterator[str]) -> Iterator[str]:
    for x, y in zip(a, b, strict=False):
        if x != y:
            return
        yield x


def _joined(lines: list[str]) -> str:
    return " ".join(line.strip() for line in lines)
