"""Tasks on a Dask cluster, as `processes` has them on this machine; Dask is imported only when a cluster is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from volid.exceptions import InputError


@contextmanager
def cluster(address: str) -> Iterator[Any]:
    """A client of the Dask scheduler at `address`. Raises `InputError` when Dask is missing or nobody answers."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("`scheduler` needs Dask: pip install 'volid[distributed]'") from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"`scheduler={address}`: no Dask scheduler answers there ({error or 'time out'})") from None
    try:
        yield client
    finally:
        client.close()


def gather(
    client: Any, function: Callable[..., Any], tasks: list[tuple[Any, ...]], shared: Any
) -> Iterator[tuple[int, Any]]:
    """(number, result) of function(shared, *task) for every task, as they finish; dead workers' tasks are done again."""
    from distributed import as_completed

    handle = client.submit(_hold, shared, pure=False)
    futures = {client.submit(function, handle, *task, pure=False, retries=3): i for i, task in enumerate(tasks)}
    for future in as_completed(list(futures)):
        yield futures.pop(future), future.result()


def _hold(value: Any) -> Any:
    """A task whose result Dask can make again when the worker that holds it dies."""
    return value
