"""Writes a plan's messages as C++ tables that a host reads at run time: the same as the engine's."""

from __future__ import annotations

from wirebond.protocol.payload_rules import PayloadRules
from wirebond.protocol.plan import MatchTest, Plan


def rows(function: str, plan: Plan) -> list[str]:
    """Return a function that gives the messages' rows, with tables beside it."""
    lines = []
    entries = []
    for place, row in enumerate(plan.messages):
        name = f"{function}_{place}"
        lines += _rules(name, row.rules)
        tests = row.tests if plan.matches else ()
        lines += _tests(name, tests)
        rules = row.rules
        told = (
            f"{{{name}_constants, {name}_counts, {len(rules.constants)}, {len(rules.counts)}, {rules.most_beside}}}",
            f"{{{name}_tests, {len(tests)}}}",
        )
        shape = f"{{{row.index}, {row.min_payload}, {row.max_payload}, {row.seed}}}"
        entries.append(f"      {{{row.id}u, {shape}, {_cpp(row.only_expected)}, {', '.join(told)}}},")
    return [
        *lines,
        f"inline std::vector<wirebond::MessageRow> {function}() {{",
        "  return {",
        *entries,
        "  };",
        "}",
    ]


def _rules(name: str, rules: PayloadRules) -> list[str]:
    constants = [f"{{{c.at}, {c.behind}, {c.mask}, {c.value}}}" for c in rules.constants]
    counts = [
        f"{{{c.at}, {c.behind}, {c.bytes}, wirebond::ByteOrder::{c.order}, {c.shift}, {c.mask}ull, {c.unit}, {c.most}, "
        f"{c.step}, {-1 if c.agrees_with is None else c.agrees_with}}}"
        for c in rules.counts
    ]
    return [
        f"inline constexpr wirebond::PayloadConstant {name}_constants[] = {{{', '.join(constants) or '{}'}}};",
        f"inline constexpr wirebond::PayloadCount {name}_counts[] = {{{', '.join(counts) or '{}'}}};",
    ]


def _tests(name: str, tests: tuple[MatchTest, ...]) -> list[str]:
    entries = [
        f"{{wirebond::MatchOf::{t.of}, {t.place}, {_cpp(t.or_next)}, {_cpp(t.is_one)}, {t.bytes}, "
        f"wirebond::ByteOrder::{t.order}, {t.shift}, {t.at}, {t.mask}ull, {t.low}ull, {t.high}ull}}"
        for t in tests
    ]
    return [f"inline constexpr wirebond::MatchTest {name}_tests[] = {{{', '.join(entries) or '{}'}}};"]


def _cpp(value: bool) -> str:
    return str(value).lower()
