"""Logs of ROS: bags of ROS 1 and 2 and MCAP files, a channel a number of a topic's messages."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.extras import require_extra
from jumpvision.base.schema import InputError

from .held import Channel, Held

LARGEST = 10_000_000  # numbers of a log in memory
REPAIR_TOOL = {".mcap": "mcap recover", ".bag": "rosbag reindex", ".db3": "sqlite3 with .recover"}  # of each format


def bag(path: Path, asked: Collection[str]) -> Held:
    """Read channels TOPIC.FIELD, as `/drive.velocity.x`; of a series its place, `/scan.ranges.3`, or the
    name beside it, `/joint_states.position.hip`.

    Their clock is the messages' own stamp, else the time at which they were recorded, which is TOPIC.recorded too [s].
    """
    with require_extra("rosbags", f"{path}: reading bags", "ros"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            topics = {c.topic for c in reader.connections}
            wanted = {t for t in topics for name in asked if name.startswith(f"{t}.")}
            rows: dict[str, list[dict[str, float]]] = defaultdict(list)
            stamps: dict[str, list[int]] = defaultdict(list)
            held, began = 0, dict[str, int]()
            for connection, at, raw in _messages(reader, wanted):
                topic = connection.topic
                message = reader.deserialize(raw, connection.msgtype)
                began.setdefault(topic, at)
                row = {f"{topic}.recorded": 1e-9 * (at - began[topic])}
                row |= {f"{topic}.{n}": x for n, x in _numbers(message)}
                first = topic not in rows
                kept = {n: x for n, x in row.items() if first or n in asked}
                if (held := held + len(kept)) > LARGEST:
                    raise InputError([f"{path}: more than {LARGEST:,} numbers; keep the part that matters"])
                rows[topic].append(kept)
                stamps[topic].append(_stamp(message) or at)
    except InputError:
        raise
    except Exception as e:  # rosbags raises many kinds for what is no bag
        if (profile := _profile(path)) not in (None, "ros2"):
            raise InputError(
                [
                    f"{path}: an MCAP file of the profile '{profile}': its messages (JSON, Protobuf, ROS 1) are not "
                    "those of ROS 2; save them as CSV, columns such as time_s,position_m: the package mcap gives each "
                    "message's log_time [ns] and data by mcap.reader.make_reader(open(FILE, 'rb')).iter_messages()"
                ]
            ) from None
        raise InputError(
            [f"{path}: not a bag, or damaged ({e}); copy it again, or mend it: {REPAIR_TOOL[path.suffix.lower()]}"]
        ) from None
    names = [n for topic in rows.values() for n in topic[0]]
    channels = {n: c for t in wanted for n in asked if n.startswith(f"{t}.") and (c := _channel(n, rows[t], stamps[t]))}
    return Held(names, channels)


def _messages(reader: Any, wanted: Collection[str]) -> Iterator[Any]:
    """All messages of the wanted topics in order; the first of every other, which tells its names."""
    other = [c for c in reader.connections if c.topic not in wanted]
    for connection in other:
        yield from itertools.islice(reader.messages([connection]), 1)
    if mine := [c for c in reader.connections if c.topic in wanted]:
        yield from reader.messages(mine)


def _channel(name: str, rows: list[dict[str, float]], stamps: list[int]) -> Channel | None:
    """One number of each message; nothing where none has it."""
    if not any(name in row for row in rows):
        return None
    values = np.array([row.get(name, np.nan) for row in rows])
    if back := next((k for k in range(1, len(stamps)) if stamps[k] <= stamps[k - 1]), 0):
        topic = next(iter(rows[0])).removesuffix(".recorded")
        late = 1e-9 * (stamps[back - 1] - stamps[back])
        reason = f"{topic}: the stamp of message {back + 1} is {late:g} s before that of message {back}"
        remedy = f"take the times at which they were recorded, columns.time_s = '{topic}.recorded', or give rate"
        return Channel(name, values, untimed=f"{reason}; {remedy}")
    since = (np.array(stamps, dtype=np.int64) - stamps[0]).astype(float)  # ns
    return Channel(name, values, clock=1e-9 * since, began=np.datetime64(stamps[0], "ns"))


def _profile(path: Path) -> str | None:
    """Return the profile in the header of an MCAP file; None of another file."""
    with path.open("rb") as file:
        head = file.read(1024)
    if not head.startswith(b"\x89MCAP0\r\n\x01"):
        return None
    return head[21 : 21 + int.from_bytes(head[17:21], "little")].decode(errors="replace")


def _stamp(message: Any) -> int:
    """The message's own time [ns]; 0 where it has none, or never set it."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * 10**9 + int(getattr(stamp, "nanosec", 0))


def _numbers(value: Any, beside: Any = None) -> Iterator[tuple[str, float]]:
    """Every number of a message with its name; a series' by the names that the message has beside it."""
    if isinstance(value, bool | int | float | np.number):
        yield "", float(value)
    elif isinstance(value, list | tuple | np.ndarray):
        labels = beside if beside is not None and len(beside) == len(value) else range(len(value))
        for label, one in zip(labels, value):
            yield from ((f"{label}.{n}".rstrip("."), x) for n, x in _numbers(one))
    elif fields := getattr(value, "__dataclass_fields__", None):
        labels = getattr(value, "name", None)
        for field in fields:
            if not field.startswith("__"):
                inner = _numbers(getattr(value, field), labels if isinstance(labels, list) else None)
                yield from ((f"{field}.{n}".rstrip("."), x) for n, x in inner)
