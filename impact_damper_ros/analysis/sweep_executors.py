"""Where the rigs of a sweep are run: in this process, in processes here, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future
from typing import Any, Protocol, Self, TypeVar

from .process_pool import ProcessPool

__all__ = [
    'DaskWorkers',
    'FutureLike',
    'Here',
    'LocalWorkers',
    'SweepExecutor',
    'Workers',
    'WorkersError',
]

T = TypeVar('T')
#: Blocks under way for each worker, so that none waits for the next one.
_AHEAD = 2
#: For the scheduler, and then for one of its workers, to be there.
_CONNECT_SECONDS = 15.0
_WORKERS_SECONDS = 15.0


class WorkersError(RuntimeError):
    """The workers cannot do the work; the message says why."""


class FutureLike(Protocol):
    """What a sweep needs of the futures of an executor."""

    def add_done_callback(self, fn: Callable[[Any], object], /) -> None:
        """Call a function with the future once it is done."""

    def result(self) -> Any:
        """Return the result, or raise what went wrong."""

    def cancel(self) -> object:
        """Give up what has not begun."""


class SweepExecutor(Protocol):
    """What a sweep needs of an executor: any of the kind of `concurrent.futures` has it."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> FutureLike:
        """Have a function called somewhere."""


class Workers(Protocol):
    """An executor, and what else is known of it."""

    @property
    def losses(self) -> tuple[type[BaseException], ...]:
        """What a future raises if its worker died."""

    @property
    def at_once(self) -> int:
        """How many blocks to have under way, 0 if there are no workers now."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> FutureLike:
        """Have a function called somewhere."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: object, *_: object) -> None: ...


class Here:
    """Run everything in this process, at once."""

    losses: tuple[type[BaseException], ...] = ()
    at_once = 1

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Call a function."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args))
        except Exception as error:
            future.set_exception(error)
        return future

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Nothing is left to end."""


class LocalWorkers:
    """
    Processes on this machine; if one dies, all are replaced.

    Parameters
    ----------
    jobs : int
        How many.
    """

    losses: tuple[type[BaseException], ...] = (BrokenExecutor,)

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._pool = ProcessPool(jobs)

    @property
    def at_once(self) -> int:
        """How many blocks to have under way."""
        return _AHEAD * self._jobs

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Have a function called in a process."""
        try:
            return self._pool.submit(fn, *args)
        except BrokenExecutor:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = ProcessPool(self._jobs)
            return self._pool.submit(fn, *args)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *rest: object) -> None:
        # Those under way need not be waited for after an exception: they are run again
        self._pool.__exit__(kind, *rest)


class DaskWorkers:
    """
    The workers of a Dask cluster.

    Parameters
    ----------
    address : str
        Address of its scheduler, such as tcp://10.0.0.1:8786.

    Raises
    ------
    ImportError
        If dask.distributed is not installed; the message says how to install it.
    OSError
        If there is no scheduler at the address, or it has no workers.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client, KilledWorker
        except ImportError as error:
            raise ImportError(
                f'dask.distributed, which --scheduler needs, cannot be imported ({error}): '
                'install it with "pip install distributed", or the package with its extra [dask]'
            ) from error
        self.losses: tuple[type[BaseException], ...] = (KilledWorker,)
        try:
            self._client: Any = Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise OSError(
                f'no Dask scheduler at {address} ({error}): give the address that it prints when '
                'it starts, such as tcp://10.0.0.1:8786'
            ) from error
        try:
            self._client.wait_for_workers(1, timeout=_WORKERS_SECONDS)
        except TimeoutError as error:
            self._client.close()
            raise OSError(
                f'the Dask scheduler at {address} has no workers: start some, as with '
                f'"dask worker {address}"'
            ) from error
        self._executor: Any = self._client.get_executor(pure=False)

    @property
    def at_once(self) -> int:
        """How many blocks to have under way; workers may come and go, 0 if there are none."""
        try:
            threads: dict[str, int] = self._client.nthreads()
        except OSError as error:
            raise WorkersError(f'the scheduler cannot be reached any more ({error})') from error
        return _AHEAD * sum(threads.values())

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> FutureLike:
        """Have a function called on a worker."""
        future: FutureLike = self._executor.submit(fn, *args)
        return future

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self._executor.shutdown(wait=False)
        self._client.close(timeout=5)
