"""Connect to a running Dask scheduler, and require equal package versions on all machines.

Who reaches the scheduler may run any program on all its machines and on this one: Dask sends pickles both ways. So
another machine is reached over TLS only, unless the address begins with INSECURE.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from tactilevision.errors import ClusterError, installed_version
from tactilevision.files.documents import read_json

# Versions that determine a result's digits and must be equal on all machines.

PACKAGES = ("tactilevision", "numpy", "scipy", "opencv-contrib-python-headless")
MISSING = "none"


def versions() -> dict[str, str]:
    """Return the versions of this process."""
    return {name: installed_version(name) or MISSING for name in PACKAGES}


def refusal(here: dict[str, str], there: dict[str, str]) -> ClusterError | None:
    """Return what is wrong with a worker's versions; None if they are those of this process."""
    for name in PACKAGES:
        if there.get(name, MISSING) != here[name]:
            return ClusterError(
                f"a worker has another version of {name}, so results would differ",
                where="--cluster",
                value=there.get(name, MISSING),
                remedy=f"Install {name} {here[name]} on every worker, and start the workers again.",
            )
    return None


# Connection to a running scheduler, checked before anything is written.

ANSWER_S = 20  # s until a silent scheduler counts as absent
LATE_S = 1  # s more, for what answers but is not a scheduler
WORKER_S = 60  # s to wait for a first worker
WHERE = "--cluster"
INSECURE = "insecure:"  # before an address or file: plain TCP to another machine is meant
ENCRYPTED = ("tls", "wss")  # schemes of addresses that are encrypted and authenticated


def address_of(where: str) -> str:
    """Return the scheduler's address: `where` itself, or the content of the scheduler's file of that name.

    A scheduler's file is as powerful as a program: it decides whose code runs here.
    """
    path = Path(where)
    if "://" in where or not (path.suffix or path.exists()):
        return where
    try:
        address = read_json(path).get("address")
    except OSError as fault:
        remedy = "Give tls://HOST:PORT, or the file that `dask scheduler --scheduler-file` wrote."
        raise ClusterError("there is no such scheduler file", where=WHERE, value=where, remedy=remedy) from fault
    if not isinstance(address, str):
        raise ClusterError(
            "the scheduler file has no `address`", where=where, remedy="Let `dask scheduler` write it."
        )
    return address


def open_client(where: str) -> Any:
    """Connect to workers that have this library in this version. Raises ClusterError if there are none."""
    try:
        from distributed import Client
    except ImportError as fault:
        remedy = "pip install '.[cluster]' in the repository, or omit --cluster."
        what = "a cluster needs dask.distributed, which is not installed"
        raise ClusterError(what, where=WHERE, remedy=remedy) from fault
    address = address_of(where.removeprefix(INSECURE))
    try:
        _check_form(address, plain=where.startswith(INSECURE))
        client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except ClusterError:
        raise
    except (OSError, ValueError) as fault:
        remedy = "Start one with `dask scheduler`, or omit --cluster. Its dashboard has another port."
        raise ClusterError("no Dask scheduler answers", where=WHERE, value=address, remedy=remedy) from fault
    except TypeError as fault:  # of distributed, for a TLS that has no certificates
        remedy = "Name certificates in Dask's configuration (distributed.comm.tls)."
        raise ClusterError("TLS is not configured here", where=WHERE, value=address, remedy=remedy) from fault
    try:
        _check(client, address)
    except BaseException:
        client.close()
        raise
    return client


def _check_form(address: str, *, plain: bool) -> None:
    """Check an address, for Dask waits long for a host that cannot exist, and its encryption unless `plain`."""
    scheme, _, rest = address.rpartition("://")
    host, _, port = rest.rpartition(":")
    if scheme == "inproc":
        return
    if not host or not port.isdecimal():
        remedy = "Give tls://HOST:PORT, or the file that `dask scheduler --scheduler-file` wrote."
        raise ClusterError("this is not a scheduler's address", where=WHERE, value=address, remedy=remedy)
    try:
        found = socket.getaddrinfo(host.strip("[]"), int(port))
    except (OSError, UnicodeError, OverflowError) as fault:
        remedy = "Check its name, or give the number of its address."
        raise ClusterError("no machine of that name is known", where=WHERE, value=host, remedy=remedy) from fault
    hosts = {str(one[4][0]).partition("%")[0] for one in found}
    if scheme not in ENCRYPTED and not plain and not all(ipaddress.ip_address(one).is_loopback for one in hosts):
        raise ClusterError(
            "another machine is reached without encryption, and who reads along may run programs on all machines",
            where=WHERE,
            value=address,
            remedy=f"Use tls://. Where all users of the network are trusted, give {INSECURE}{address}.",
        )
    if scheme in ("", "tcp"):
        with ThreadPoolExecutor(1) as aside:  # a notebook's main thread has a running loop
            aside.submit(lambda: asyncio.run(_greet(address))).result()


async def _greet(address: str) -> None:
    """Raise OSError or ValueError if anything but Dask answers, such as a web page, for which Dask waits."""
    from distributed.comm import connect

    comm = await asyncio.wait_for(connect(address, timeout=ANSWER_S), ANSWER_S + LATE_S)
    comm.abort()


def check_cluster(where: str) -> None:
    """Raise ClusterError if `open_client` would, before anything is written."""
    open_client(where).close()


def _check(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=WORKER_S)
    except TimeoutError as fault:
        remedy = f"Start some with: dask worker {address}"
        raise ClusterError("the cluster has no workers", where=WHERE, value=address, remedy=remedy) from fault
    here = versions()
    try:
        answers = client.run(_asking())
    except Exception as fault:  # any answer of a foreign worker
        remedy = "Start the workers with the Python and dask of this machine."
        raise ClusterError(
            "a worker cannot report its versions", where=WHERE, value=str(fault), remedy=remedy
        ) from fault
    for there in answers.values():
        different = refusal(here, there)
        if different is not None:
            raise different


def _asking() -> Callable[[], dict[str, str]]:
    """Return a function that travels by value, so that a worker without this library can answer it too."""

    def ask() -> dict[str, str]:
        try:
            from tactilevision.cluster.connect import versions
        except ImportError:
            return {}
        return versions()

    return ask
