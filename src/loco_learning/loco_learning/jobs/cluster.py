# SPDX-License-Identifier: Apache-2.0
"""Jobs on the workers of an existing dask cluster."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from loco_control.exceptions import GraphError, ParameterError

from .base import Failure, Jobs, outcome, sendable

CONNECT_SECONDS = 10.0  # timeout of a scheduler and its workers


class Cluster(Jobs):
    """Jobs on the workers of a dask cluster, which repeats the jobs of a worker that dies.

    Args:
        payload: Pickled function and shared arguments.
        address: Address of the scheduler, such as ``tcp://127.0.0.1:8786``; ``tls://`` is
            required for another machine.

    Raises:
        ParameterError: There is no response from the address, its workers cannot import loco, or
            it is another machine without TLS.
    """

    def __init__(self, payload: bytes, address: str):
        _check_door(address)
        try:
            import distributed
        except ImportError as error:
            raise ParameterError(
                f"--scheduler needs dask: {error}; it comes with `./loco install cluster`"
            ) from error
        self._distributed, self._address = distributed, address
        try:
            self._client = distributed.Client(
                address, timeout=CONNECT_SECONDS, set_as_default=False
            )
        except (OSError, TimeoutError, ValueError) as error:
            raise ParameterError(
                f"no dask scheduler answers at {address!r}; start one with "
                "`dask scheduler --host 127.0.0.1` and `dask worker ADDRESS`, or leave --scheduler "
                "out to use processes of this machine"
            ) from error
        self._try()
        # a task, not data of a worker: the scheduler runs it again if the worker that has it dies
        self._function = self._client.submit(_function, payload, pure=False)

    def _try(self) -> None:
        """Reject a cluster whose workers cannot run this package."""
        try:
            self._client.wait_for_workers(1, timeout=CONNECT_SECONDS)
            self._client.submit(_ready, pure=False).result(timeout=CONNECT_SECONDS)
        except Exception as error:
            self.close()
            raise ParameterError(
                f"the dask cluster at {self._address} has no worker that can import loco_learning: "
                f"{type(error).__name__}: {error}"
            ) from error

    def outcomes(self, jobs: Sequence[tuple]) -> Iterator[tuple[int, Any]]:
        """See `Jobs`."""
        submit = partial(self._client.submit, _remote, self._function, pure=False)
        index = {submit(job): i for i, job in enumerate(jobs)}
        for future in self._distributed.as_completed(index, loop=self._client.loop):
            if future.status == "cancelled":
                raise GraphError(
                    f"the dask scheduler at {self._address} is gone; results so far are kept, "
                    "start again to go on"
                )
            error = future.exception()
            if error is None:
                yield index[future], future.result()
            else:  # the worker died repeatedly
                yield index[future], Failure(f"{type(error).__name__}: {error}")

    def close(self) -> None:
        """Disconnect from the cluster, which keeps running; pending jobs are cancelled."""
        self._client.close(timeout=2.0)


def _check_door(address: str) -> None:
    """Reject addresses of other machines without TLS, since pickled functions are sent to them.

    Raises:
        ParameterError: The address is that of another machine, without TLS.
    """
    protocol, _, rest = address.rpartition("://")
    host = rest.rpartition(":")[0].strip("[]") or rest
    local = host == "localhost" or host == "::1" or re.fullmatch(r"127(\.\d{1,3}){3}", host)
    if protocol in ("", "tcp", "ucx", "ws") and not local and rest != address:
        raise ParameterError(
            f"{address!r} is of another machine; dask hands pickled functions to whoever answers, "
            "so use tls:// with certificates, or a tunnel to 127.0.0.1"
        )


def _function(payload: bytes) -> Callable[..., Any]:
    function, shared = pickle.loads(payload)  # noqa: S301, from the caller of this cluster
    return partial(function, *shared)


def _remote(function: Callable[..., Any], job: tuple) -> Any:
    return sendable(outcome(function, job))


def _ready() -> bool:
    return True
