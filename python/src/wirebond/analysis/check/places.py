"""Finds the place in a protocol file that a finding is about."""

from __future__ import annotations

from wirebond.errors import ProtocolFileError
from wirebond.protocol.problems import WHOLE_FILE, Place, Problems
from wirebond.protocol.text import yaml_tree
from wirebond.protocol.text.short_forms import written_out
from wirebond.protocol.text.yaml_tree import Mapping, Node, Sequence


class Places:
    """The places of one file; all of them unknown for a protocol that comes from no file."""

    def __init__(self, root: Node | None = None) -> None:
        self._root = root

    @classmethod
    def of_text(cls, text: str) -> Places:
        """Return the places of a protocol that was read from this text."""
        try:
            return cls(written_out(yaml_tree.parse(text, Problems(""))))
        except ProtocolFileError:
            return cls()

    def at(self, *steps: str | int) -> Place:
        """Return the place under these keys and list indices, as far as they lead."""
        node, place = self._root, WHOLE_FILE if self._root is None else self._root.place
        for step in steps:
            if isinstance(node, Mapping) and step in node.entries:
                entry = node.entries[str(step)]
                node, place = entry.value, entry.key_place
            elif isinstance(node, Sequence) and isinstance(step, int) and step < len(node.items):
                node = node.items[step]
                place = node.place
            else:
                break
        return place

    def part(self, kind: str, index: int = 0) -> Place:
        """Return the place of the frame's part of this kind: the ``index``-th one if there are several."""
        found = [place for key, place in self._parts() if key == kind]
        return found[index] if index < len(found) else self.at("frame")

    def _parts(self) -> list[tuple[str, Place]]:
        root = self._root
        todo = [root.get("frame")] if isinstance(root, Mapping) else []
        found: list[tuple[str, Place]] = []
        while todo:
            node = todo.pop()
            for item in node.items if isinstance(node, Sequence) else ():
                for key, entry in item.entries.items() if isinstance(item, Mapping) else ():
                    found.append((key, entry.key_place))
                    todo.append(entry.value)  # parts within a stuffed part
                    runs = entry.value.entries.values() if isinstance(entry.value, Mapping) else ()
                    found += [("check", run.key_place) for run in runs if "check" in getattr(run.value, "entries", ())]
        return found
