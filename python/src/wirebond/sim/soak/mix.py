"""The traffic that both ends of a soak offer: which messages, how often, from which samples."""

from __future__ import annotations

from dataclasses import dataclass, replace

from wirebond.codec import Codec
from wirebond.errors import UsageError
from wirebond.protocol.model import End
from wirebond.protocol.planning import told_by_request
from wirebond.sim.soak.samples import SAMPLES, samples

SEED_PERIOD = 0.001  # seconds: each topic and each task of the overload experiment runs at 1 kHz

# The overload experiment of the ENTERPRIZE team: five topics of two messages each, against four tasks.
_SEED_TASKS = {"enterprize": ("sentry_gimbal_msg",) * 4}
_SEED_TIMES = 2


@dataclass(frozen=True)
class Turn:
    """A topic of the host, or a task of the MCU: what it sends each time that it runs."""

    message: str
    times: int


@dataclass(frozen=True)
class Mix:
    """``host`` and ``mcu`` run at one period each. Empty where that end sends no message."""

    host: tuple[Turn, ...]
    mcu: tuple[Turn, ...]
    is_seed: bool  # the experiment that `--load seed` means

    def turns(self, end: End) -> tuple[Turn, ...]:
        return self.host if end == End.HOST else self.mcu

    def bytes_per_round(self, codec: Codec, end: End) -> float:
        """Return the bytes of all topics or tasks together, each once; with the mean size of the samples."""
        turns = self.turns(end)
        sizes = {turn.message: [len(frame) for frame in samples(codec, turn.message, end)] for turn in turns}
        return sum(turn.times * sum(sizes[turn.message]) / SAMPLES for turn in turns)


def without_services(codec: Codec) -> Codec:
    """Return the protocol without services, whose messages a link would send by itself. Here no link sends them."""
    return Codec(replace(codec.model, services=())) if codec.model.services else codec


def mix_of(codec: Codec) -> Mix:
    """Return the experiment's own mix for its protocol. For others: every message of an end once, services left out.

    :raises UsageError: the protocol has what a soak cannot account for.
    """
    _refuse_what_cannot_be_told(codec)
    model = codec.model
    services = {name for service in model.services for name in dict(service.messages).values()}
    ends = {
        end: [m.name for m in model.messages if m.sent_by(end) and m.name not in services]
        for end in (End.HOST, End.MCU)
    }
    if not any(ends.values()):
        raise UsageError(f"{model.name}: neither end sends a message that is not a service; there is nothing to soak")
    tasks = _SEED_TASKS.get(model.name)
    is_seed = tasks is not None and all(name in ends[End.MCU] for name in tasks)
    times = _SEED_TIMES if is_seed else 1
    return Mix(
        tuple(Turn(name, times) for name in ends[End.HOST]),
        tuple(Turn(name, 1) for name in (tasks if is_seed and tasks else ends[End.MCU])),
        is_seed,
    )


def _refuse_what_cannot_be_told(codec: Codec) -> None:
    model = codec.model
    by_request = sorted(name for end in (End.HOST, End.MCU) for name in told_by_request(model.messages, end))
    names = ", ".join(by_request)
    reasons = {
        "silence ends its frames, and the adapter of a soak hands bytes over without it": model.format.ends_by_silence,
        f"only a request identifies these messages, but a soak sends them without one: {names}": by_request,
    }
    for reason, holds in reasons.items():
        if holds:
            raise UsageError(f"{model.name}: a soak cannot account for every frame of this protocol: {reason}")
