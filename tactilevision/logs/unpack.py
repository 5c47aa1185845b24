"""Packed parts of a log, unpacked to what they state and no further."""

from __future__ import annotations

import bz2
from typing import Any

from tactilevision.door.limits import check, limit
from tactilevision.errors import InputError
from tactilevision.logs.library import library

ZSTD = b"\x28\xb5\x2f\xfd"  # how every frame of Zstandard begins (RFC 8878, 3.1.1)


def unpack(kind: str, data: bytes, *, where: object) -> bytes:
    """The bytes behind one packed part; `kind` is "", none, bz2, lz4 or zstd.

    Never more than the limit MAX_ARRAY_MB is unpacked. Raises InputError beyond it, for another kind, and for a
    part that is cut short.
    """
    if kind in ("", "none"):
        return data
    if kind not in _OPEN:
        raise InputError("a part of the log is packed in a way that is not read", where=where, value=kind)
    most = int(limit("MAX_ARRAY_MB") * 1e6)
    try:
        unpacker = _OPEN[kind]()
        found = bytes(unpacker.decompress(data, max_length=most + 1))
    except Exception as fault:
        raise _damaged(where, str(fault)) from fault
    check(len(found) / 1e6, "MAX_ARRAY_MB", what="a part of the log, unpacked, in MB,", where=where)
    if not unpacker.eof:
        raise _damaged(where, "it is cut short")
    return found


def _damaged(where: object, said: str) -> InputError:
    return InputError(
        f"a packed part of the log is damaged: {said[:120]}",
        where=where,
        remedy="Copy it again from where it came.",
    )


def _lz4() -> Any:
    return library("lz4.frame").LZ4FrameDecompressor()


class _Zstd:
    """Zstandard with a limit, as the standard library has it for bz2."""

    def __init__(self) -> None:
        self.eof = False

    def decompress(self, data: bytes, max_length: int) -> bytes:
        """At most `max_length` bytes."""
        opened = library("zstandard").ZstdDecompressor(max_window_size=1 << 27).stream_reader(data)
        found: bytes = opened.read(max_length)
        stated = library("zstandard").frame_content_size(data)
        self.eof = stated < 0 or len(found) >= min(stated, max_length)
        return found


_OPEN: dict[str, Any] = {"bz2": bz2.BZ2Decompressor, "lz4": _lz4, "zstd": _Zstd}
