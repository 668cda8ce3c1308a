"""Parameters of the MCU over the service `parameter`: read, set within their ranges, kept in files. Any thread."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from wirebond.arguments import shown
from wirebond.codec import Message
from wirebond.errors import LinkDownError, MessageError, ParameterError, RequestTimeoutError, UsageError
from wirebond.link.service_values import filled
from wirebond.whole_file import write_whole

if TYPE_CHECKING:
    from wirebond.link.receiving import Receiving

MOST_INDICES = 256  # that are read of a table without names
READ_TRIES = 3  # a read changes nothing, so that it may be asked again
DEFAULT_TIMEOUT = 1.0  # seconds for each answer
_OK, _NO_SUCH_INDEX, _OUT_OF_RANGE = 0, 1, 2  # `result`, as core/include/wirebond/mcu/services.hpp has it
_MOST_BYTES = 1 << 20  # of a file
_ENDINGS = {".json": "JSON", ".yaml": "YAML", ".yml": "YAML"}

Progress = Callable[[int, int], object]


class Parameters:
    """The parameters of one MCU. ``link.parameters`` gives it.

    A parameter is named by the enum of the service's ``index``, where the file has one there; otherwise by its index,
    as a number or its digits. Each call waits for the MCU's answers.

    :param link: the link.
    :param header: the frame's own named fields; where frames have addresses, they say whose parameters these are.
    """

    def __init__(self, link: Receiving, header: Mapping[str, Any] | None = None) -> None:
        model = link.codec.model
        service = model.service("parameter")
        if service is None:
            raise UsageError(f"{model.name} maps no `parameter` service")
        self._link = link
        self._header = header
        roles = dict(service.messages)
        self._read, self._set = model.message(roles["read"]), model.message(roles["set"])
        fields = {f.name: f for f in model.message(roles["value"]).fields}
        self._value, self._result = fields["value"], dict(fields["result"].enum)
        self._index = next(f for f in self._set.fields if f.name == "index")
        self._reads = next(f for f in self._read.fields if f.name == "index")
        self._answered = fields["index"]
        self._names = dict(self._index.enum) or dict(self._reads.enum)

    def at(self, header: Mapping[str, Any]) -> Parameters:
        """Return the parameters of another MCU on the line.

        :param header: whom to ask, such as ``{"servo": 3}``.
        :returns: its parameters.
        """
        return Parameters(self._link, header)

    @property
    def names(self) -> tuple[str, ...]:
        """The names that the file gives them; empty: the MCU's table has indices alone."""
        return tuple(self._names)

    def list(self, progress: Progress | None = None, *, timeout: float = DEFAULT_TIMEOUT) -> dict[str, float]:
        """Read every parameter of the MCU, by name or index.

        A table without names is read from index 0 on until the MCU reports its end, at most 256 of them.

        :param progress: called as ``progress(done, all)`` after each; ``all`` is 0 where it is not known.
        :param timeout: seconds for each answer; each is asked three times at most.
        :returns: the values in force.
        :raises RequestTimeoutError: the MCU does not answer.
        """
        names = list(self._names) or [str(i) for i in range(min(1 << self._index.width, MOST_INDICES))]
        found: dict[str, float] = {}
        for number, name in enumerate(names):
            try:
                found[name] = self.get(name, timeout=timeout)
            except ParameterError as error:
                if error.reason != "no_such_index":
                    raise
                if not self._names:
                    break
            if progress is not None:
                progress(number + 1, len(self._names))
        return found

    def get(self, parameter: str | int, *, timeout: float = DEFAULT_TIMEOUT) -> float:
        """Return the value in force.

        :param parameter: its name or index.
        :param timeout: seconds for each answer; it is asked three times at most.
        :returns: the value, of the type that the file gives it.
        :raises ParameterError: neither the file nor the MCU has such a parameter.
        :raises RequestTimeoutError: the MCU does not answer.
        """
        index = self._index_of(parameter)
        values = filled(self._read, {"index": self._written(self._reads, index)})
        for further in range(READ_TRIES - 1, -1, -1):
            try:
                reply = self._link.request(self._read.name, values, timeout=timeout, header=self._header)
                break
            except RequestTimeoutError:
                if not further:
                    raise
        return self._in_force(parameter, index, reply, None)

    def set(self, parameter: str | int, value: float, *, timeout: float = DEFAULT_TIMEOUT) -> float:
        """Set one parameter, and wait for the MCU's acknowledgement.

        :param parameter: its name or index.
        :param value: of the type and within the range that the file gives it; the MCU has ranges of its own.
        :param timeout: seconds for the answer. It is sent once: after a timeout the value may be set or not.
        :returns: the value in force now, as the MCU acknowledges it.
        :raises ParameterError: the MCU refuses it, with its reason; or there is no such parameter.
        :raises MessageError: the value is not of the type, or not within the range, of the file.
        :raises RequestTimeoutError: the MCU does not answer.
        """
        index = self._index_of(parameter)
        values = self._set_values(index, value)
        self._link.codec.encode(self._set.name, values)  # with the field's own sentence
        reply = self._link.request(self._set.name, values, timeout=timeout, header=self._header)
        return self._in_force(parameter, index, reply, value)

    def set_all(
        self, values: Mapping[str, float], progress: Progress | None = None, *, timeout: float = DEFAULT_TIMEOUT
    ) -> dict[str, float]:
        """Set all of these parameters, or none. Names, types, the file's ranges, and that the MCU has each parameter
        are checked before the first one is set. If the MCU then refuses a value or does not answer, those that were set
        get their previous values back.

        :param values: by name or index.
        :param progress: called as ``progress(done, all)`` after each that was set.
        :param timeout: as for ``get`` and ``set``.
        :returns: the values in force, as the MCU acknowledged them.
        :raises ParameterError: a value is refused. ``refused`` has a sentence for each, and the text names those that
            could not get their previous values back.
        :raises RequestTimeoutError: the MCU does not answer.
        """
        before, refused = self._values_before(values, timeout)
        if refused:
            raise ParameterError(_refusal("nothing was set", refused), refused=refused)
        done: dict[str, float] = {}
        for number, (name, value) in enumerate(values.items()):
            try:
                done[name] = self.set(name, value, timeout=timeout)
            except ParameterError as error:
                left = self._set_back(before, done, timeout)
                refused[name] = str(error)
                raise ParameterError(
                    _refusal(f"nothing was set{left}", refused),
                    parameter=name,
                    reason=error.reason,
                    value=error.value,
                    refused=refused,
                ) from None
            except RequestTimeoutError as error:
                left = self._set_back(before, [*done, name], timeout)  # it may be set: only the answer may be lost
                error.args = (f"{error}\nnothing was set{left}",)
                raise
            if progress is not None:
                progress(number + 1, len(values))
        return done

    def save(
        self, path: str | Path, progress: Progress | None = None, *, timeout: float = DEFAULT_TIMEOUT
    ) -> dict[str, float]:
        """Read all parameters, and write them to a file: YAML or JSON, by its ending.

        :param path: of the file, which is written whole or not at all.
        :param progress: as for ``list``.
        :param timeout: as for ``list``.
        :returns: what was written.
        :raises RequestTimeoutError: the MCU does not answer; the file is unchanged.
        """
        kind = _kind(Path(path))
        values = self.list(progress, timeout=timeout)
        if kind == "JSON":
            text = json.dumps(values, indent=2) + "\n"
        else:
            lines = [f"{name}: {json.dumps(value)}" for name, value in values.items()]
            text = "\n".join([f"# Parameters of {self._link.codec.name}, as its MCU had them.", *lines, ""])
        write_whole(Path(path), text)
        return values

    def load(
        self, path: str | Path, progress: Progress | None = None, *, timeout: float = DEFAULT_TIMEOUT
    ) -> dict[str, float]:
        """Set all parameters of a file, or none, as ``set_all`` does.

        :param path: of a file that ``save`` wrote, or a similar one with some of the parameters.
        :param progress: called as ``progress(done, all)`` after each that was set.
        :param timeout: as for ``list`` and ``set``.
        :returns: the values in force, as the MCU acknowledged them.
        :raises ParameterError: the file cannot be used, or a value is refused; as for ``set_all``.
        :raises RequestTimeoutError: the MCU does not answer.
        """
        try:
            return self.set_all(_read_file(Path(path)), progress, timeout=timeout)
        except ParameterError as error:
            if error.refused:
                error.args = (f"{path}: {error}",)
            raise

    # ---- names and values

    def __iter__(self) -> Iterator[str]:
        return iter(self.list())

    def _values_before(self, values: Mapping[str, float], timeout: float) -> tuple[dict[str, float], dict[str, str]]:
        """Return the values in force, and a sentence for each that cannot be set. Nothing is set."""
        before: dict[str, float] = {}
        refused: dict[str, str] = {}
        named: dict[int, str] = {}
        for name, value in values.items():
            try:
                index = self._index_of(name)
                if index in named:
                    raise ParameterError(f"it is the same parameter as {named[index]}; give one of them")
                named[index] = name
                self._link.codec.encode(self._set.name, self._set_values(index, value))
                before[name] = self.get(name, timeout=timeout)
            except (ParameterError, MessageError) as error:
                refused[name] = str(error)
        return before, refused

    def _set_back(self, before: Mapping[str, float], names: Iterable[str], timeout: float) -> str:
        """Give them their previous values.

        :returns: for the sentence that reports it: those for which this failed.
        """
        failed: dict[str, str] = {}
        for name in names:
            try:
                self.set(name, before[name], timeout=timeout)
            except (ParameterError, MessageError, RequestTimeoutError, LinkDownError) as error:
                failed[name] = str(error)
        if not failed:
            return ""
        several = "; ".join(f"{name} could not be set back to {before[name]}: {why}" for name, why in failed.items())
        return f", except that {several}"

    def _index_of(self, parameter: str | int) -> int:
        if isinstance(parameter, str) and parameter in self._names:
            return self._names[parameter]
        digits = parameter if isinstance(parameter, int) and not isinstance(parameter, bool) else _whole(parameter)
        if digits is None:
            known = ", ".join(self._names)
            advice = f"it has {known}" if known else "its parameters have no names; give an index, such as 0"
            raise ParameterError(
                f"{self._link.codec.name} has no parameter {shown(parameter)}; {advice}",
                parameter=str(parameter),
                reason="no_such_name",
            )
        if not 0 <= digits < 1 << self._index.width:
            raise ParameterError(
                f"an index of {self._link.codec.name} is 0 to {(1 << self._index.width) - 1}, not {digits}",
                parameter=str(parameter),
                reason="no_such_index",
            )
        return digits

    def _set_values(self, index: int, value: object) -> dict[str, Any]:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise MessageError(f"{self._set.name}.value is {shown(value)}; expected a number")
        return filled(self._set, {"index": self._written(self._index, index), "value": value})

    @staticmethod
    def _written(field: Any, index: int) -> int | str:
        return next((name for name, number in field.enum if number == index), index)

    def _in_force(self, parameter: str | int, index: int, reply: Message, asked: float | None) -> float:
        """Return the value of an answer.

        :raises ParameterError: it is a refusal, or for another parameter.
        """
        fields = reply.fields
        of = dict(self._answered.enum).get(fields["index"], fields["index"])
        if of != index:
            raise ParameterError(
                f"the MCU answered for parameter {fields['index']} instead of {parameter}; check its firmware",
                parameter=str(parameter),
                reason="wrong_index",
            )
        value, here = fields["value"], ""
        limits = next(f for f in self._set.fields if f.name == "value")
        if limits.minimum is not None and limits.maximum is not None:
            here = f". The file here allows {limits.minimum:g} to {limits.maximum:g}, and the MCU less"
        value = self._value.shortest(value)
        result = fields["result"]
        number = self._result.get(result, result)
        if number == _OK:
            return float(value) if self._value.is_float else int(value)
        reason, words = {
            _NO_SUCH_INDEX: ("no_such_index", f"the MCU has no parameter {parameter}"),
            _OUT_OF_RANGE: (
                "out_of_range",
                f"the MCU refused {asked} for parameter {parameter}: it is out of range; {value} stays in force{here}",
            ),
        }.get(number, (str(result), f"the MCU refused parameter {parameter}: {result}; {value} stays in force"))
        raise ParameterError(words, parameter=str(parameter), reason=reason, value=value)


def _whole(text: object) -> int | None:
    is_index = isinstance(text, str) and text.isascii() and text.isdigit() and len(text) < 12
    return int(str(text)) if is_index else None


# ---- files


def _kind(path: Path) -> str:
    kind = _ENDINGS.get(path.suffix.lower())
    if kind is None:
        raise UsageError(f"{path} has an unknown ending; name a file such as {path.stem or 'parameters'}.yaml or .json")
    return kind


def _read_file(path: Path) -> dict[str, Any]:
    """Read names and values.

    :raises ParameterError: the file has something else.
    """
    kind = _kind(path)
    with path.open("rb") as file:
        data = file.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise ParameterError(f"{path} has more than {_MOST_BYTES} bytes; it is not a file of parameters")
    try:
        text = data.decode("utf-8-sig")
        found = (
            json.loads(text, object_pairs_hook=_unique) if kind == "JSON" else YAML(typ="safe", pure=True).load(text)
        )
    except MarkedYAMLError as error:
        mark = error.problem_mark
        place = f":{mark.line + 1}:{mark.column + 1}" if mark is not None else ""
        raise ParameterError(f"{path}{place}: it is not valid YAML: {error.problem or error.context}") from None
    except (ValueError, YAMLError, RecursionError) as error:
        raise ParameterError(f"{path}: it cannot be read as {kind}: {str(error)[:200]}") from None
    if not isinstance(found, dict) or not found:
        raise ParameterError(f"{path}: expected names and values, such as `kp: 1.5`, one per line")
    named = {str(name): value for name, value in found.items()}
    if len(named) < len(found):  # `1` and `"1"` of YAML are one parameter
        twice = next(name for name, count in Counter(map(str, found)).items() if count > 1)
        raise ParameterError(f"{path}: {twice} is listed twice; remove one of them")
    return named


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a name stands twice")
    return found


def _refusal(head: str, refused: Mapping[str, str]) -> str:
    return "\n".join([f"{head}; {len(refused)} refused:", *(f"  {name}: {why}" for name, why in refused.items())])
