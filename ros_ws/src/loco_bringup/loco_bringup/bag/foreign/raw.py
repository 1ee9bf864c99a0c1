# SPDX-License-Identifier: Apache-2.0
"""Base class of bags that are read message by message."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from pathlib import Path

import numpy as np

from loco_control.exceptions import NameUnknownError
from loco_control.ros.messages.plain import Message, message_class

from ..reader import Bag, TopicInfo, records_from


class RawBag(Bag):
    """A bag with the interface of `Bag`, whose subclass implements `raw`.

    Args:
        paths: Files of the bag, in their order.

    Attributes:
        definitions: Message definitions stored in the bag, by message type.
    """

    def __init__(self, paths: list[Path]):
        self.paths = paths
        self.folder = paths[0].parent
        self.path = paths[0] if len(paths) == 1 else self.folder
        self.topics: dict[str, TopicInfo] = {}
        self.definitions: dict[str, str] = {}
        self._kinds: dict[str, type[Message]] = {}

    coding = ""  # description of the conversion to CDR

    @cached_property
    def _span(self) -> tuple[int, int]:
        """First and last log time [ns]."""
        times = [self.times(name) for name, topic in self.topics.items() if topic.count]
        times = [t for t in times if len(t)]
        return (min(t.min() for t in times), max(t.max() for t in times)) if times else (0, 0)

    @property
    def start(self) -> float:
        """Log time of the first message [s]."""
        return self._span[0] / 1e9

    @property
    def end(self) -> float:
        """Log time of the last message [s]."""
        return self._span[1] / 1e9

    @property
    def metadata(self) -> dict[str, str]:
        """Metadata of a loco run: always empty, since such bags have none."""
        return {}

    def attachment(self, name: str) -> bytes:
        """Content of an attachment; such bags have none, so it always raises.

        Raises:
            NameUnknownError: Bags of this kind have no attachments.
        """
        raise NameUnknownError(f"attachment in {self.path.name}", name, ())

    def attachments(self) -> dict[str, int]:
        """Attachments of the bag: always empty."""
        return {}

    def times(self, topic: str) -> np.ndarray:
        """Log times of a topic [ns], shape (n,), in the order of arrival."""
        return self.raw(topic)[0]

    def offered(self, topic: str) -> str:
        """YAML text of the QoS profiles of a topic: always empty, since none is recorded."""
        return "[]"

    def check(self) -> None:
        """Read every message once.

        Raises:
            BagError: A message cannot be read.
        """
        for name in self.topics:
            self.raw(name)

    def records_of(self, topics: Iterable[str]) -> dict[str, np.ndarray]:
        """Records of several topics of constant layout, by the requested names.

        Raises:
            BagError: A topic is empty or its messages differ in layout.
        """
        return {topic: records_from(self, self.resolve(topic)) for topic in topics}

    def _kind(self, name: str) -> type[Message]:
        if name not in self._kinds:
            kind = self.topics[name].type
            self._kinds[name] = message_class(kind, self.definitions.get(kind, ""))
        return self._kinds[name]
