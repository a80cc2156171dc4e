# SPDX-License-Identifier: Apache-2.0
"""Rays through structures, on the CPU: needs neither a daemon nor a device."""
from __future__ import annotations

import ctypes as c
from typing import Any, Optional, Sequence, Union

import numpy as np
import numpy.typing as npt

from . import _structs as s
from ._enums import RayFlags
from ._errors import check
from ._handle import Handle
from ._library import lib
from .client import Result
from .container import Structure
from .geometry import Array

#: The type of arrays of rays, and of hits: bvhd_cpu.h describes the fields.
RAY = s.RAY
HIT = s.HIT
#: What a hit has as its instance if there is none.
NO_INSTANCE = 0xFFFFFFFF

_ANY_HIT = 0x1

Bytes = Union[Result, Structure, npt.NDArray[np.uint8], bytes, bytearray, memoryview]


def rays(
    origins: npt.ArrayLike,
    directions: npt.ArrayLike,
    *,
    tmin: npt.ArrayLike = 0.0,
    tmax: npt.ArrayLike = np.inf,
    masks: npt.ArrayLike = 0xFF,
    flags: npt.ArrayLike = RayFlags.NONE,
    times: npt.ArrayLike = 0.0,
) -> Array:
    """Makes an array of rays. Origins and directions are of shape (n, 3), or one of them (3,).

    The others are one number for all rays, or n. Directions need not have unit length.
    """
    start, direction = np.broadcast_arrays(
        np.atleast_2d(np.asarray(origins, np.float32)),
        np.atleast_2d(np.asarray(directions, np.float32)),
    )
    if start.ndim != 2 or start.shape[1] != 3:
        raise ValueError(f"origins and directions: arrays of shape {start.shape} are not (n, 3)")
    made = np.zeros(len(start), RAY)
    made["origin"] = start
    made["direction"] = direction
    made["tmin"] = tmin
    made["tmax"] = tmax
    made["mask"] = masks
    made["flags"] = flags
    made["time"] = times
    return made


def _numbers(primitives: npt.ArrayLike) -> Array:
    array: Array = np.atleast_1d(np.asarray(primitives))
    if array.size == 0:
        return np.zeros(0, np.uint32)
    if array.dtype.kind not in "iu" or array.ndim != 1:
        raise ValueError(
            f"primitives: an array of shape {array.shape} and type {array.dtype} is not (n,) of"
            " integers"
        )
    if int(array.min()) < 0 or int(array.max()) > 0xFFFFFFFF:
        raise ValueError("primitives: a number is negative or needs more than 32 bits")
    return array.astype(np.uint32)


class Scene:
    """One structure, or a top level with the bottom levels that it names, ready to be traced.

    structures: the bottom levels in the order in which the instances of the top level name them
        first, and last the top level; or one bottom level alone. All bytes are checked.

    Any number of threads may trace at once.
    """

    def __init__(self, structures: Sequence[Bytes]) -> None:
        arrays = [_aligned(structure) for structure in structures]
        blobs = (s.CpuBlob * len(arrays))()
        for blob, array in zip(blobs, arrays):
            blob.data, blob.size = array.ctypes.data, array.size
        options = s.CpuSceneOptions(
            struct_size=c.sizeof(s.CpuSceneOptions), blobs=blobs, blob_count=len(arrays)
        )
        pointer, error = c.c_void_p(), s.Error()
        check(lib.bvhd_cpu_scene_create(options, pointer, error), error)

        def destroy(scene: c.c_void_p) -> None:
            lib.bvhd_cpu_scene_destroy(scene)
            arrays.clear()  # the scene reads their bytes

        self._handle = Handle(pointer, destroy)

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Frees the scene as soon as no thread traces through it any more."""
        self._handle.close()

    @property
    def bounds(self) -> npt.NDArray[np.float32]:
        """The minimum and the maximum of what can be hit, 6 numbers."""
        numbers = (c.c_float * 6)()
        with self._handle as scene:
            lib.bvhd_cpu_scene_bounds(scene, numbers)
        return np.array(numbers, np.float32)

    def closest_hit(self, rays: Array) -> Array:
        """Returns an array of HIT, the closest hit of each ray. A miss has t = inf."""
        return self._trace(rays, s.HIT, 0)

    def any_hit(self, rays: Array) -> npt.NDArray[np.bool_]:
        """Returns for each ray whether it hits anything: shadows and visibility."""
        return np.isfinite(self._trace(rays, np.dtype("<f4"), _ANY_HIT))

    def positions(
        self,
        primitives: npt.ArrayLike,
        *,
        geometry: int = 0,
        structure: int = 0,
        time: Optional[float] = None,
    ) -> npt.NDArray[np.float32]:
        """Returns the corners of triangles by their numbers in a geometry, of shape (n, 3, 3).

        structure: the position of the bottom level in the scene. It was built with
        `BuildFlags.ALLOW_DATA_ACCESS`. Corners are those after the geometry's transform.
        time: from 0 to 1; what moves needs one.
        """
        numbers = _numbers(primitives)
        corners = np.empty((len(numbers), 3, 3), np.float32)
        error, kind = s.Error(), c.c_float * 9
        with self._handle as scene:
            for number, row in zip(numbers, corners):
                where, room = (scene, structure, geometry, number), kind.from_buffer(row)
                if time is None:
                    status = lib.bvhd_cpu_scene_positions(*where, room, error)
                else:
                    status = lib.bvhd_cpu_scene_positions_at(*where, time, room, error)
                check(status, error)
        return corners

    def _trace(self, rays: Array, kind: np.dtype[Any], flags: int) -> Array:
        if rays.dtype != s.RAY or rays.ndim != 1:
            raise ValueError(
                f"rays: an array of shape {rays.shape} and type {rays.dtype} is not (n,) of"
                " bvhd.cpu.RAY"
            )
        rays = np.ascontiguousarray(rays)
        hits = np.zeros(len(rays), kind)
        trace = s.CpuTrace(
            struct_size=c.sizeof(s.CpuTrace),
            rays=rays.ctypes.data,
            ray_size=s.RAY.itemsize,
            hits=hits.ctypes.data,
            hit_size=kind.itemsize,
            ray_count=len(rays),
            flags=flags,
        )
        error = s.Error()
        with self._handle as scene:
            check(lib.bvhd_cpu_scene_trace(scene, trace, error), error)
        return hits


def _aligned(structure: Bytes) -> npt.NDArray[np.uint8]:
    """The bytes as an array, which is copied if it is not aligned to 16 bytes."""
    if isinstance(structure, (Result, Structure)):
        return structure.array
    array = np.frombuffer(structure, np.uint8)
    if array.ctypes.data % 16 == 0:
        return array
    room = np.empty(array.size + 15, np.uint8)
    first = -room.ctypes.data % 16
    copy = room[first : first + array.size]
    copy[:] = array
    return copy
