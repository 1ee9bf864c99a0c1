# SPDX-License-Identifier: Apache-2.0
"""`loco extract`: some topics of a bag, each at a fraction of its rate, as a smaller bag."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from loco_control.exceptions import BagError, ParameterError
from loco_control.files import whole_folder
from loco_control.reading import as_text, parse_yaml

from .reader import Bag
from .writer import BagWriter, Limits

DECIDES = "experiment.yaml"  # the only attachment copied with selected topics


def extract(
    bag: Bag | str | Path,
    out: str | Path,
    topics: Sequence[str] | None = None,
    limits: Limits | None = None,
) -> Path:
    """Copy topics and the experiment; time stamps and bytes of the messages are unchanged.

    Args:
        bag: Bag folder or ``.mcap`` file.
        out: New bag folder.
        topics: Names; ``NAME:N`` keeps each N-th message. None for all, with all files inside.
        limits: Size and time after which the next file of the new bag begins.

    Returns:
        Folder of the new bag.

    Raises:
        BagError: `out` holds a bag already, or the disk has too little space.
        NameUnknownError: The bag has no such topic.
        ParameterError: N is not a whole number from 1.
    """
    bag, out = bag if isinstance(bag, Bag) else Bag(bag), Path(out)
    selected = [*bag.topics] if topics is None else topics
    periods = {bag.resolve(name): every for name, every in map(_parsed, selected)}
    if not periods:
        raise BagError("no topic to copy; name at least one")
    inside = [name for name in bag.attachments() if topics is None or name == DECIDES]
    files = {name: bag.attachment(name) for name in inside}
    messages = []
    for name, every in periods.items():
        times, data = bag.raw(name)
        rows = zip(times.tolist(), data, strict=True)
        messages += [(t, name, d) for i, (t, d) in enumerate(rows) if i % every == 0]
    if any(out.glob("*.mcap")):
        raise BagError(f"{out} holds a bag already; choose another folder")
    try:
        with whole_folder(out) as folder:
            writer = BagWriter(folder, bag.metadata, limits=limits)
            try:
                _announce(bag, writer, periods)
                for t, name, data in sorted(messages, key=lambda m: m[0]):
                    writer.write(name, data, t)
                for name, data in files.items():
                    writer.attach(name, data)
            finally:
                writer.close()
            if writer.failed:
                raise BagError(f"the new bag is not complete: {writer.failed}")
    except OSError as error:
        raise BagError(f"no bag can be written at {out}: {error.strerror or error}") from None
    return out


def _parsed(text: str) -> tuple[str, int]:
    name, _, every = text.partition(":")
    if every and not (every.isdigit() and int(every) > 0):
        raise ParameterError(f"topic {text!r} must be NAME or NAME:N with N a whole number from 1")
    return name, int(every or 1)


def _announce(bag: Bag, writer: BagWriter, names: Sequence[str] | dict[str, int]) -> None:
    for channel in bag.summary.channels.values():
        if channel.topic in names:
            schema = bag.summary.schemas.get(channel.schema_id)
            if schema is None or channel.message_encoding != "cdr":
                raise BagError(
                    f"{bag.path.name}: {channel.topic} is no topic of ROS 2 "
                    f"({channel.message_encoding or 'no encoding'}); leave it out with --topics"
                )
            source = f"type of {channel.topic} in {bag.path}"
            qos = parse_yaml(channel.metadata.get("offered_qos_profiles", "[]"), source)
            hash_ = channel.metadata.get("topic_type_hash", "")
            writer.add_topic(channel.topic, schema.name, as_text(schema.data, source), hash_, qos)
