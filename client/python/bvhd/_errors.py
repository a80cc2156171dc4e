# SPDX-License-Identifier: Apache-2.0
"""The exception of the package."""
from __future__ import annotations

from . import _structs as s
from ._enums import Status
from ._library import lib


class Error(Exception):
    """A call or a build failed: which rule, where and why."""

    status: Status
    vuid: str  # "VUID-..." if the rule is one of Vulkan's, else ""
    where: str  # the place, such as "infos[0].pGeometries[1].geometry.triangles.vertexStride"
    text: str  # the reason

    def __init__(self, status: Status, vuid: str = "", where: str = "", text: str = "") -> None:
        super().__init__(status, vuid, where, text)
        self.status, self.vuid, self.where, self.text = status, vuid, where, text

    def __str__(self) -> str:
        return ": ".join(
            part for part in (self.status.name, self.where, self.text, self.vuid) if part
        )


def error_from(error: s.Error) -> Error:
    """Makes an exception from a struct bvhd_error."""
    return Error(
        Status(error.status),
        lib.bvhd_vuid_string(error.vuid).decode(),
        error.where.decode(errors="replace"),
        error.text.decode(errors="replace"),
    )


def check(status: int, error: s.Error) -> None:
    """Raises the error of a call unless its status is OK."""
    if status != Status.OK:
        error.status = status
        raise error_from(error)
