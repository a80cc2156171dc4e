# SPDX-License-Identifier: Apache-2.0
"""What structures are built from, in numpy arrays: triangles, boxes, round kinds and instances.

Arrays are not copied if the library can read them as they are: rows may be any number of bytes
apart, so a column of an interleaved vertex buffer will do. An array must not be changed until the
batch that uses it is copied (`Batch.is_copied`).
"""
from __future__ import annotations

import ctypes as c
import itertools
from dataclasses import dataclass, field
from typing import Any, Optional, Sequence, Union

import numpy as np
import numpy.typing as npt

from . import _structs as s
from ._enums import (
    BuildFlags,
    EndCaps,
    GeometryFlags,
    IndexingMode,
    InstanceFlags,
    VertexFormat,
)

Array = npt.NDArray[Any]

_STYPE_BUILD = 1000150000
_STYPE_AABBS = 1000150003
_STYPE_INSTANCES = 1000150004
_STYPE_TRIANGLES = 1000150005
_STYPE_GEOMETRY = 1000150006
_STYPE_MOTION_TRIANGLES = 1000327000
_STYPE_SWEPT_SPHERES = 1000429009
_STYPE_SPHERES = 1000429010
_TYPE_SPHERES = 1000429004
_TYPE_SWEPT_SPHERES = 1000429005
_INDEX_NONE = 1000165000
_INDEX_TYPES = {np.dtype("u2"): 0, np.dtype("u4"): 1}

_FORMATS = {
    ("f2", 2): VertexFormat.R16G16_SFLOAT,
    ("f2", 3): VertexFormat.R16G16B16_SFLOAT,
    ("f2", 4): VertexFormat.R16G16B16A16_SFLOAT,
    ("f4", 2): VertexFormat.R32G32_SFLOAT,
    ("f4", 3): VertexFormat.R32G32B32_SFLOAT,
    ("f4", 4): VertexFormat.R32G32B32A32_SFLOAT,
    ("f8", 2): VertexFormat.R64G64_SFLOAT,
    ("f8", 3): VertexFormat.R64G64B64_SFLOAT,
    ("f8", 4): VertexFormat.R64G64B64A64_SFLOAT,
}

_RADIUS_FORMATS = {np.dtype("f2"): 76, np.dtype("f4"): 100}

# The handles of this process, by which instances name structures.
_handles = itertools.count(1)


def _rows(array: Array, alignment: int) -> Array:
    """Returns the array or a copy: rows are contiguous, and a multiple of `alignment` apart."""
    inner = array.ndim == 1 or array.shape[1] <= 1 or array.strides[1] == array.itemsize
    outer = len(array) <= 1 or (array.strides[0] > 0 and array.strides[0] % alignment == 0)
    if inner and outer and array.ctypes.data % alignment == 0 and array.dtype.isnative:
        return array
    return np.ascontiguousarray(array, array.dtype.newbyteorder("="))


def _stride(array: Array) -> int:
    """Returns the bytes from one row to the next."""
    if len(array) > 1:
        return int(array.strides[0])
    return array.itemsize * int(np.prod(array.shape[1:], dtype=np.int64))


def _vertex_format(vertices: Array) -> VertexFormat:
    kind = f"{vertices.dtype.kind}{vertices.dtype.itemsize}"
    columns = vertices.shape[1] if vertices.ndim == 2 else 0
    if (kind, columns) not in _FORMATS:
        raise ValueError(
            f"vertices: an array of shape {vertices.shape} and type {vertices.dtype} is none of"
            " (n, 2), (n, 3) and (n, 4) of float16, float32 or float64; other formats need"
            " vertex_format"
        )
    return _FORMATS[kind, columns]


def _vertices(
    vertices: npt.ArrayLike, wanted: Optional[VertexFormat]
) -> tuple[Array, VertexFormat]:
    """Returns the vertices as the library can read them, and their format."""
    array = np.asarray(vertices)
    vertex_format = _vertex_format(array) if wanted is None else VertexFormat(wanted)
    array = _rows(array, min(array.itemsize, 8) if array.dtype.kind in "iuf" else 1)
    row = array.itemsize * int(np.prod(array.shape[1:], dtype=np.int64))
    if row < vertex_format.size:
        raise ValueError(
            f"vertices: a row has {row} bytes, {vertex_format.name} {vertex_format.size}"
        )
    return array, vertex_format


def _end_vertices(
    end_vertices: npt.ArrayLike, vertices: Array, wanted: Optional[VertexFormat]
) -> tuple[Array, Array]:
    """Returns the vertices at the time 1, and those at 0, with their rows equally far apart."""
    array = np.asarray(end_vertices)
    if array.shape != vertices.shape or array.dtype != vertices.dtype:
        raise ValueError(
            f"end_vertices: an array of shape {array.shape} and type {array.dtype} differs from"
            f" that of the vertices, {vertices.shape} and {vertices.dtype}"
        )
    array, _ = _vertices(array, wanted)
    if _stride(array) == _stride(vertices):
        return array, vertices
    return np.ascontiguousarray(array), np.ascontiguousarray(vertices)


def _indices(indices: npt.ArrayLike, columns: int) -> Array:
    """Returns the indices one after the other: of each primitive, that many."""
    array = np.asarray(indices)
    if array.size == 0:
        return np.zeros(0, np.uint32)
    if (
        array.dtype.kind not in "iu"
        or array.size % columns != 0
        or array.ndim not in (1, 2)
        or (array.ndim == 2 and (columns == 1 or array.shape[1] != columns))
    ):
        shapes = f"neither (m, {columns}) nor ({columns} * m,)" if columns > 1 else "not (m,)"
        raise ValueError(
            f"indices: an array of shape {array.shape} and type {array.dtype} is {shapes} of"
            " integers"
        )
    flat = np.ascontiguousarray(array).reshape(-1)
    if flat.dtype in _INDEX_TYPES:
        return flat
    if int(flat.min()) < 0 or int(flat.max()) > 0xFFFFFFFF:
        raise ValueError("indices: a number is negative or needs more than 32 bits")
    return flat.astype(np.uint16 if flat.dtype.itemsize == 1 else np.uint32)


def _transform(transform: npt.ArrayLike) -> Array:
    array = np.ascontiguousarray(transform, np.float32)
    if array.shape != (3, 4):
        raise ValueError(f"transform: an array of shape {array.shape} is not (3, 4)")
    return array


@dataclass(frozen=True, eq=False)
class Triangles:
    """A geometry of triangles.

    vertices: float32, float64 or float16 of shape (n, 2), (n, 3) or (n, 4); with vertex_format rows
        of any type that hold at least that format. A third component that is missing is 0, a fourth
        is not read.
    indices: integers of shape (m, 3) or (3 * m,); without them each three vertices are a triangle.
    transform: a matrix of 3 rows and 4 columns, which is applied to the vertices.
    end_vertices: where the vertices are at the time 1, in an array of the same shape and type;
        `vertices` then says where they are at the time 0, and they move between in straight lines.
    """

    vertices: npt.ArrayLike
    indices: Optional[npt.ArrayLike] = None
    transform: Optional[npt.ArrayLike] = None
    flags: GeometryFlags = GeometryFlags.NONE
    vertex_format: Optional[VertexFormat] = None
    end_vertices: Optional[npt.ArrayLike] = None

    def _fill(self, geometry: s.Geometry, extent: s.Range) -> list[Any]:
        """Fills Vulkan's structs, and returns what they point to."""
        vertices, vertex_format = _vertices(self.vertices, self.vertex_format)
        ends = None
        if self.end_vertices is not None:
            ends, vertices = _end_vertices(self.end_vertices, vertices, self.vertex_format)
        count = len(vertices)
        # The library may read the vertex maxVertex, which cannot be less than 0.
        if count == 0:
            vertices = np.zeros((1,) + vertices.shape[1:], vertices.dtype)
            ends = vertices if ends is not None else None
        kept: list[Any] = [vertices]
        geometry.geometryType = 0
        triangles = geometry.geometry.triangles
        if ends is not None:
            data = s.MotionTrianglesData(sType=_STYPE_MOTION_TRIANGLES)
            data.vertexData = ends.ctypes.data
            triangles.pNext = c.addressof(data)
            kept += [data, ends]
        triangles.sType = _STYPE_TRIANGLES
        triangles.vertexFormat = vertex_format
        triangles.vertexData = vertices.ctypes.data
        triangles.vertexStride = _stride(vertices)
        triangles.maxVertex = len(vertices) - 1
        triangles.indexType = _INDEX_NONE
        extent.primitiveCount = count // 3
        if self.indices is not None:
            indices = _indices(self.indices, 3)
            if count == 0 and len(indices) > 0:
                raise ValueError("indices: there are no vertices")
            triangles.indexType = _INDEX_TYPES[indices.dtype]
            triangles.indexData = indices.ctypes.data
            extent.primitiveCount = len(indices) // 3
            kept.append(indices)
        elif count % 3 != 0:
            raise ValueError(f"vertices: {count} of them, without indices, is no multiple of 3")
        if self.transform is not None:
            transform = _transform(self.transform)
            triangles.transformData = transform.ctypes.data
            kept.append(transform)
        return kept


@dataclass(frozen=True, eq=False)
class Aabbs:
    """A geometry of axis-aligned boxes: float32 of shape (n, 6), minimum and maximum."""

    boxes: npt.ArrayLike
    flags: GeometryFlags = GeometryFlags.NONE

    def _fill(self, geometry: s.Geometry, extent: s.Range) -> list[Any]:
        boxes = np.asarray(self.boxes, np.float32)
        if boxes.ndim != 2 or boxes.shape[1] != 6:
            raise ValueError(f"boxes: an array of shape {boxes.shape} is not (n, 6)")
        boxes = _rows(boxes, 8)
        geometry.geometryType = 1
        aabbs = geometry.geometry.aabbs
        aabbs.sType = _STYPE_AABBS
        aabbs.data = boxes.ctypes.data
        aabbs.stride = _stride(boxes)
        extent.primitiveCount = len(boxes)
        return [boxes]


def _radii(radii: npt.ArrayLike, count: int) -> tuple[Array, int]:
    """Returns the radii, and the bytes from one to the next: 0 where one is for all vertices."""
    array = np.asarray(radii)
    if array.dtype not in _RADIUS_FORMATS:
        if array.dtype.kind not in "iuf":
            raise ValueError(f"radii: an array of type {array.dtype} is not of numbers")
        array = array.astype(np.float32)
    if array.ndim == 0:
        return array.reshape(1).copy(), 0
    if array.shape != (count,):
        raise ValueError(
            f"radii: an array of shape {array.shape} is neither one number nor ({count},), one for"
            " each vertex"
        )
    array = _rows(array, array.itemsize)
    return array, _stride(array)


def _fill_ends(
    data: s.SpheresData, shape: Union[Spheres, SweptSpheres], columns: int, following: int
) -> tuple[int, list[Any]]:
    """Fills what the structs of spheres and of swept spheres begin with.

    columns: the indices of a primitive. following: the vertices that are used after one that an
        index names. Returns the number of vertices or indices, and what the struct points to.
    """
    vertices, data.vertexFormat = _vertices(shape.vertices, shape.vertex_format)
    radii, data.radiusStride = _radii(shape.radii, len(vertices))
    data.vertexData = vertices.ctypes.data
    data.vertexStride = _stride(vertices)
    data.radiusFormat = _RADIUS_FORMATS[radii.dtype]
    data.radiusData = radii.ctypes.data
    data.indexType = _INDEX_NONE
    if shape.indices is None:
        return len(vertices), [data, vertices, radii]
    indices = _indices(shape.indices, columns)
    # The library reads vertices up to the greatest index: it is told no number of vertices.
    last = int(indices.max()) + following if len(indices) > 0 else -1
    if last >= len(vertices):
        raise ValueError(f"indices: vertex {last} is used, but there are {len(vertices)} vertices")
    data.indexType = _INDEX_TYPES[indices.dtype]
    data.indexData = indices.ctypes.data
    data.indexStride = indices.itemsize
    return len(indices), [data, vertices, radii, indices]


@dataclass(frozen=True, eq=False)
class Spheres:
    """A geometry of spheres. Rays hit them from outside only.

    vertices: their centres, as the vertices of triangles.
    radii: float32 or float16 of shape (n,), one for each vertex; or one number for all. A sphere of
        radius 0 is never hit.
    indices: integers of shape (m,): which vertices are spheres. Without them all are.
    """

    vertices: npt.ArrayLike
    radii: npt.ArrayLike
    indices: Optional[npt.ArrayLike] = None
    flags: GeometryFlags = GeometryFlags.NONE
    vertex_format: Optional[VertexFormat] = None

    def _fill(self, geometry: s.Geometry, extent: s.Range) -> list[Any]:
        data = s.SpheresData(sType=_STYPE_SPHERES)
        extent.primitiveCount, kept = _fill_ends(data, self, 1, 0)
        geometry.geometryType = _TYPE_SPHERES
        geometry.pNext = c.addressof(data)
        return kept


@dataclass(frozen=True, eq=False)
class SweptSpheres:
    """A geometry of linear swept spheres: what a sphere sweeps on its way between two vertices.

    vertices: the centres of their ends, as the vertices of triangles.
    radii: float32 or float16 of shape (n,), one for each vertex; or one number for all.
    indices: with IndexingMode.LIST integers of shape (m, 2) or (2 * m,), the two ends of each;
        without them each two vertices are the ends of one. With IndexingMode.SUCCESSIVE integers of
        shape (m,), the first end of each, whose second end is the vertex after it.
    caps: EndCaps.NONE leaves both ends open, to rays too. EndCaps.CHAINED closes them; with
        IndexingMode.SUCCESSIVE a swept sphere that begins where the one before it ends has no cap
        there.
    """

    vertices: npt.ArrayLike
    radii: npt.ArrayLike
    indices: Optional[npt.ArrayLike] = None
    mode: IndexingMode = IndexingMode.LIST
    caps: EndCaps = EndCaps.CHAINED
    flags: GeometryFlags = GeometryFlags.NONE
    vertex_format: Optional[VertexFormat] = None

    def _fill(self, geometry: s.Geometry, extent: s.Range) -> list[Any]:
        mode = IndexingMode(self.mode)
        if mode == IndexingMode.SUCCESSIVE and self.indices is None:
            raise ValueError("indices: IndexingMode.SUCCESSIVE needs them")
        data = s.SweptSpheresData(sType=_STYPE_SWEPT_SPHERES)
        data.indexingMode = mode
        data.endCapsMode = EndCaps(self.caps)
        columns, following = (2, 0) if mode == IndexingMode.LIST else (1, 1)
        count, kept = _fill_ends(data, self, columns, following)
        if count % columns != 0:
            raise ValueError(f"vertices: {count} of them, without indices, is no multiple of 2")
        extent.primitiveCount = count // columns
        geometry.geometryType = _TYPE_SWEPT_SPHERES
        geometry.pNext = c.addressof(data)
        return kept


Geometry = Union[Triangles, Aabbs, Spheres, SweptSpheres]
GEOMETRIES = (Triangles, Aabbs, Spheres, SweptSpheres)


@dataclass(frozen=True, eq=False)
class BottomLevel:
    """A structure over geometries of one kind: triangles, boxes, spheres or swept spheres.

    With triangles that have end_vertices it has BuildFlags.MOTION; others in it stand still.

    source: the result that this one updates, or a reference to it: the same geometries, moved. It
        was built with BuildFlags.ALLOW_UPDATE, and so is this one.
    """

    geometries: Sequence[Geometry]
    flags: BuildFlags = BuildFlags.NONE
    source: Optional[Any] = None
    handle: int = field(default_factory=lambda: next(_handles), init=False)

    def __post_init__(self) -> None:
        if any(getattr(geometry, "end_vertices", None) is not None for geometry in self.geometries):
            object.__setattr__(self, "flags", self.flags | BuildFlags.MOTION)


@dataclass(frozen=True, eq=False)
class Reference:
    """A structure that was built before, for instances: its key, and the bounds of its result.

    The service looks up bounds that are not given, and with them whether the structure moves, so
    that only a TopLevel with BuildFlags.MOTION may name it.
    """

    key: bytes
    bounds: Optional[npt.ArrayLike] = None
    slabs: Optional[npt.ArrayLike] = None
    moves: bool = False
    handle: int = field(default_factory=lambda: next(_handles), init=False)

    def _fill(self, reference: s.Reference) -> None:
        if len(self.key) != s.KEY_SIZE:
            raise ValueError(f"key: {len(self.key)} bytes instead of {s.KEY_SIZE}")
        reference.handle = self.handle
        reference.has_key = 1
        reference.key.bytes[:] = self.key
        if self.bounds is not None:
            reference.bounds[:] = _floats("bounds", self.bounds, 6)
        if self.slabs is not None:
            reference.slabs[:] = _floats("slabs", self.slabs, 20)
        reference.moves = self.moves


def _floats(name: str, values: npt.ArrayLike, count: int) -> list[float]:
    array = np.asarray(values, np.float32).reshape(-1)
    if len(array) != count:
        raise ValueError(f"{name}: {len(array)} numbers instead of {count}")
    return [float(value) for value in array]


class TopLevel:
    """A structure over instances of other structures.

    structures: what the instances may name: results, references, structures of containers, or
        bottom levels of the same batch.
    which: for each instance, the index of its structure. By default every structure has one.
    transforms: float32 of shape (n, 3, 4), from the structure's space to this one's; by default the
        identity.
    end_transforms: of the same shape, at the time 1; `transforms` then are those at the time 0, and
        each number moves between in a straight line. With shape (n, 16) both are the numbers of
        VkSRTDataNV, of which instances turn: sx, a, b, pvx, sy, c, pvy, sz, pvz, qx, qy, qz, qw,
        tx, ty, tz. The structure gets BuildFlags.MOTION, which it also needs, without
        end_transforms, over a structure that has it.
    custom_indices, masks, record_offsets, instance_flags: one number for all, or an array of n.
    source: the top level that this one updates, as for BottomLevel: as many instances.
    """

    def __init__(
        self,
        structures: Sequence[Any],
        which: Optional[npt.ArrayLike] = None,
        *,
        transforms: Optional[npt.ArrayLike] = None,
        end_transforms: Optional[npt.ArrayLike] = None,
        custom_indices: npt.ArrayLike = 0,
        masks: npt.ArrayLike = 0xFF,
        record_offsets: npt.ArrayLike = 0,
        instance_flags: npt.ArrayLike = InstanceFlags.NONE,
        flags: BuildFlags = BuildFlags.NONE,
        geometry_flags: GeometryFlags = GeometryFlags.NONE,
        source: Optional[Any] = None,
    ) -> None:
        self.structures = list(structures)
        self.source = source
        self.flags = flags if end_transforms is None else flags | BuildFlags.MOTION
        self.geometry_flags = geometry_flags
        self.handle = next(_handles)
        chosen = np.arange(len(self.structures)) if which is None else np.asarray(which)
        if chosen.ndim != 1 or (chosen.size > 0 and chosen.dtype.kind not in "iu"):
            raise ValueError(
                f"which: an array of shape {chosen.shape} and type {chosen.dtype} is not (n,) of"
                " integers"
            )
        if chosen.size > 0 and not 0 <= int(chosen.min()) <= int(chosen.max()) < len(
            self.structures
        ):
            raise ValueError(f"which: a number is none of 0 .. {len(self.structures) - 1}")
        records = _records(len(chosen), self.flags, transforms, end_transforms)
        records["index_and_mask"] = _word("custom_indices", custom_indices, "masks", masks)
        records["offset_and_flags"] = _word(
            "record_offsets", record_offsets, "instance_flags", instance_flags
        )
        handles = np.array([structure.handle for structure in self.structures], np.uint64)
        if len(chosen) > 0:
            records["reference"] = handles[chosen]
        self.records = records

    def _fill(self, geometry: s.Geometry, extent: s.Range) -> list[Any]:
        geometry.geometryType = 2
        instances = geometry.geometry.instances
        instances.sType = _STYPE_INSTANCES
        instances.data = self.records.ctypes.data
        extent.primitiveCount = len(self.records)
        return [self.records]


def _records(
    count: int,
    flags: BuildFlags,
    transforms: Optional[npt.ArrayLike],
    end_transforms: Optional[npt.ArrayLike],
) -> Array:
    """Makes the records of instances with their transforms: in Vulkan's form for these flags."""
    start: Array = np.eye(3, 4) if transforms is None else np.asarray(transforms, np.float32)
    records: Array
    if not flags & BuildFlags.MOTION:
        records = np.zeros(count, s.INSTANCE)
    elif end_transforms is None:
        records = np.zeros(count, s.MOTION_INSTANCES[0])
    else:
        end: Array = np.asarray(end_transforms, np.float32)
        kind = 2 if end.shape[-1:] == (16,) else 1
        records = np.zeros(count, s.MOTION_INSTANCES[kind])
        records["type"] = kind
        records["end_transform"] = end
    if start.shape[-1:] != records.dtype["transform"].shape[-1:]:
        raise ValueError(
            f"transforms: an array of shape {start.shape} has another form than end_transforms"
            if end_transforms is not None
            else f"transforms: an array of shape {start.shape} is not (n, 3, 4)"
        )
    records["transform"] = start
    return records


def _word(low_name: str, low: npt.ArrayLike, high_name: str, high: npt.ArrayLike) -> Array:
    """Joins 24 bits and 8 bits to a word."""
    words = []
    for name, values, bits in ((low_name, low, 24), (high_name, high, 8)):
        array = np.asarray(values, np.int64)
        if array.size > 0 and not 0 <= int(array.min()) <= int(array.max()) < 1 << bits:
            raise ValueError(f"{name}: a number does not fit into {bits} bits")
        words.append(array)
    joined: Array = words[0] | words[1] << 24
    return joined


Structure = Union[BottomLevel, TopLevel]


def as_structure(value: Union[Structure, Geometry]) -> Structure:
    """Makes a bottom level of a geometry that comes alone."""
    return BottomLevel([value]) if isinstance(value, GEOMETRIES) else value
