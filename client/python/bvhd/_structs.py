# SPDX-License-Identifier: Apache-2.0
"""The structs of bvhd.h and of Vulkan's host builds, for ctypes, and numpy's types for arrays."""
from __future__ import annotations

import ctypes as c
from typing import Any

import numpy as np

KEY_SIZE = 32


class Error(c.Structure):
    """struct bvhd_error"""

    _fields_ = [
        ("status", c.c_int),
        ("vuid", c.c_int),
        ("where", c.c_char * 120),
        ("text", c.c_char * 200),
    ]


class Key(c.Structure):
    """struct bvhd_key"""

    _fields_ = [("bytes", c.c_uint8 * KEY_SIZE)]


class ClientOptions(c.Structure):
    """struct bvhd_client_options"""

    _fields_ = [
        ("struct_size", c.c_size_t),
        ("socket_path", c.c_char_p),
        ("connect_timeout_ms", c.c_uint32),
        ("lost_after_ms", c.c_uint32),
        ("pool_size", c.c_uint64),
        ("local", c.c_int),
        ("local_threads", c.c_uint32),
    ]


class Connection(c.Structure):
    """struct bvhd_connection"""

    _fields_ = [
        ("number", c.c_uint64),
        ("uid", c.c_uint32),
        ("pid", c.c_int32),
        ("connected_ms", c.c_uint64),
        ("busy_ms", c.c_uint64),
        ("memory_bytes", c.c_uint64),
        ("result_bytes", c.c_uint64),
        ("pool_bytes", c.c_uint64),
        ("requests", c.c_uint32),
        ("items", c.c_uint32),
        ("waiting", c.c_uint32),
        ("threads", c.c_uint32),
        ("descriptors", c.c_uint32),
        ("software", c.c_char_p),
    ]


class CacheState(c.Structure):
    """struct bvhd_cache_state"""

    _fields_ = [
        ("directory", c.c_char_p),
        ("entries", c.c_uint64),
        ("bytes", c.c_uint64),
        ("budget", c.c_uint64),
        ("memory_entries", c.c_uint64),
        ("memory_bytes", c.c_uint64),
        ("memory_budget", c.c_uint64),
        ("counted", c.c_uint32),
    ]


class Format(c.Structure):
    """struct bvhd_format"""

    _fields_ = [
        ("struct_size", c.c_size_t),
        ("target", c.c_int),
        ("variant", c.c_uint32),
        ("driver_uuid", c.c_uint8 * 16),
        ("compatibility_uuid", c.c_uint8 * 16),
    ]


class Reference(c.Structure):
    """struct bvhd_reference"""

    _fields_ = [
        ("handle", c.c_uint64),
        ("has_key", c.c_int),
        ("key", Key),
        ("bounds", c.c_float * 6),
        ("slabs", c.c_float * 20),
        ("moves", c.c_int),
    ]


class TrianglesData(c.Structure):
    """VkAccelerationStructureGeometryTrianglesDataKHR"""

    _fields_ = [
        ("sType", c.c_int),
        ("pNext", c.c_void_p),
        ("vertexFormat", c.c_int),
        ("vertexData", c.c_void_p),
        ("vertexStride", c.c_uint64),
        ("maxVertex", c.c_uint32),
        ("indexType", c.c_int),
        ("indexData", c.c_void_p),
        ("transformData", c.c_void_p),
    ]


class MotionTrianglesData(c.Structure):
    """VkAccelerationStructureGeometryMotionTrianglesDataNV"""

    _fields_ = [
        ("sType", c.c_int),
        ("pNext", c.c_void_p),
        ("vertexData", c.c_void_p),
    ]


class AabbsData(c.Structure):
    """VkAccelerationStructureGeometryAabbsDataKHR"""

    _fields_ = [
        ("sType", c.c_int),
        ("pNext", c.c_void_p),
        ("data", c.c_void_p),
        ("stride", c.c_uint64),
    ]


class InstancesData(c.Structure):
    """VkAccelerationStructureGeometryInstancesDataKHR"""

    _fields_ = [
        ("sType", c.c_int),
        ("pNext", c.c_void_p),
        ("arrayOfPointers", c.c_uint32),
        ("data", c.c_void_p),
    ]


class SpheresData(c.Structure):
    """VkAccelerationStructureGeometrySpheresDataNV"""

    _fields_ = [
        ("sType", c.c_int),
        ("pNext", c.c_void_p),
        ("vertexFormat", c.c_int),
        ("vertexData", c.c_void_p),
        ("vertexStride", c.c_uint64),
        ("radiusFormat", c.c_int),
        ("radiusData", c.c_void_p),
        ("radiusStride", c.c_uint64),
        ("indexType", c.c_int),
        ("indexData", c.c_void_p),
        ("indexStride", c.c_uint64),
    ]


class SweptSpheresData(SpheresData):
    """VkAccelerationStructureGeometryLinearSweptSpheresDataNV, which begins as the other does"""

    _fields_ = [
        ("indexingMode", c.c_int),
        ("endCapsMode", c.c_int),
    ]


class GeometryData(c.Union):
    """VkAccelerationStructureGeometryDataKHR"""

    _fields_ = [
        ("triangles", TrianglesData),
        ("aabbs", AabbsData),
        ("instances", InstancesData),
    ]


class Geometry(c.Structure):
    """VkAccelerationStructureGeometryKHR"""

    _fields_ = [
        ("sType", c.c_int),
        ("pNext", c.c_void_p),
        ("geometryType", c.c_int),
        ("geometry", GeometryData),
        ("flags", c.c_uint32),
    ]


class BuildInfo(c.Structure):
    """VkAccelerationStructureBuildGeometryInfoKHR"""

    _fields_ = [
        ("sType", c.c_int),
        ("pNext", c.c_void_p),
        ("type", c.c_int),
        ("flags", c.c_uint32),
        ("mode", c.c_int),
        ("srcAccelerationStructure", c.c_uint64),
        ("dstAccelerationStructure", c.c_uint64),
        ("geometryCount", c.c_uint32),
        ("pGeometries", c.POINTER(Geometry)),
        ("ppGeometries", c.c_void_p),
        ("scratchData", c.c_void_p),
    ]


class Range(c.Structure):
    """VkAccelerationStructureBuildRangeInfoKHR"""

    _fields_ = [
        ("primitiveCount", c.c_uint32),
        ("primitiveOffset", c.c_uint32),
        ("firstVertex", c.c_uint32),
        ("transformOffset", c.c_uint32),
    ]


class Build(c.Structure):
    """struct bvhd_build"""

    _fields_ = [
        ("struct_size", c.c_size_t),
        ("info_count", c.c_uint32),
        ("infos", c.POINTER(BuildInfo)),
        ("ranges", c.POINTER(c.POINTER(Range))),
        ("references", c.POINTER(Reference)),
        ("reference_count", c.c_uint32),
        ("quality", c.c_int),
        ("target", c.c_int),
        ("layout_flags", c.c_uint32),
        ("priority", c.c_int),
        ("format", c.POINTER(Format)),
        ("rays_per_primitive", c.c_float),
        ("deadline_ms", c.c_uint32),
        ("builder", c.c_int),
        ("reserved", c.c_uint32),
    ]


class Result(c.Structure):
    """struct bvhd_result"""

    _fields_ = [
        ("error", Error),
        ("key", Key),
        ("data", c.c_void_p),
        ("size", c.c_uint64),
        ("blob", c.c_void_p),
        ("origin", c.c_int),
        ("queued_ms", c.c_double),
        ("prepare_ms", c.c_double),
        ("build_ms", c.c_double),
        ("primitives", c.c_uint64),
        ("triangles", c.c_uint64),
        ("instances", c.c_uint64),
        ("inactive", c.c_uint64),
        ("degenerate", c.c_uint64),
        ("skipped", c.c_uint64),
        ("refs", c.c_uint64),
        ("peak_bytes", c.c_uint64),
        ("depth", c.c_uint32),
        ("sah", c.c_double),
        ("original_build_ms", c.c_double),
        ("method", c.c_char_p),
        ("bounds", c.c_float * 6),
        ("slabs", c.c_float * 20),
        ("target", c.c_int),
        ("quality", c.c_int),
        ("decay", c.c_double),
        ("refits", c.c_uint32),
        ("moves", c.c_int),
    ]


class CpuBlob(c.Structure):
    """struct bvhd_cpu_blob"""

    _fields_ = [("data", c.c_void_p), ("size", c.c_uint64)]


class CpuSceneOptions(c.Structure):
    """struct bvhd_cpu_scene_options"""

    _fields_ = [
        ("struct_size", c.c_size_t),
        ("blobs", c.POINTER(CpuBlob)),
        ("blob_count", c.c_uint32),
        ("flags", c.c_uint32),
        ("handles", c.POINTER(c.c_uint64)),
    ]


class CpuTrace(c.Structure):
    """struct bvhd_cpu_trace"""

    _fields_ = [
        ("struct_size", c.c_size_t),
        ("rays", c.c_void_p),
        ("ray_size", c.c_size_t),
        ("ray_stride", c.c_size_t),
        ("hits", c.c_void_p),
        ("hit_size", c.c_size_t),
        ("hit_stride", c.c_size_t),
        ("ray_count", c.c_uint64),
        ("flags", c.c_uint32),
        ("reserved", c.c_uint32),
        ("candidate", c.c_void_p),
        ("context", c.c_void_p),
        ("counters", c.c_void_p),
    ]


class SceneStructure(c.Structure):
    """struct bvhd_scene_structure"""

    _fields_ = [
        ("data", c.c_void_p),
        ("size", c.c_uint64),
        ("key", Key),
        ("target", c.c_int),
        ("type", c.c_int),
        ("file", c.c_char_p),
        ("name", c.c_char_p),
        ("scene", c.c_char_p),
        ("bounds", c.c_float * 6),
        ("slabs", c.c_float * 20),
        ("bottoms", c.POINTER(c.c_uint32)),
        ("bottom_count", c.c_uint32),
        ("moves", c.c_int),
    ]


# struct bvhd_cpu_ray
RAY = np.dtype(
    [
        ("origin", "<f4", 3),
        ("tmin", "<f4"),
        ("direction", "<f4", 3),
        ("tmax", "<f4"),
        ("flags", "<u4"),
        ("mask", "<u4"),
        ("time", "<f4"),
        ("reserved", "<u4"),
    ]
)

# struct bvhd_cpu_hit
HIT = np.dtype(
    [
        ("t", "<f4"),
        ("u", "<f4"),
        ("v", "<f4"),
        ("instance", "<u4"),
        ("custom_index", "<u4"),
        ("geometry", "<u4"),
        ("primitive", "<u4"),
        ("flags", "<u4"),
        ("sbt_offset", "<u4"),
        ("blob", "<u4"),
        ("record", "<u4"),
        ("instance_record", "<u4"),
    ]
)

# VkAccelerationStructureInstanceKHR, whose bit fields share words: the lower 24 bits are the index
# or the offset, the upper 8 the mask or the flags.
INSTANCE = np.dtype(
    [
        ("transform", "<f4", (3, 4)),
        ("index_and_mask", "<u4"),
        ("offset_and_flags", "<u4"),
        ("reference", "<u8"),
    ]
)


def _motion_instance(numbers: tuple[int, ...], end: int) -> Any:
    """Returns the form of VkAccelerationStructureMotionInstanceNV for one of its types.

    numbers: the shape of a transform. end: where that of the time 1 is; 0 if there is none.
    """
    size = 4 * int(np.prod(numbers))
    behind = size + (end or 8)
    fields = {
        "type": ("<u4", 0),
        "transform": (("<f4", numbers), 8),
        "index_and_mask": ("<u4", behind),
        "offset_and_flags": ("<u4", behind + 4),
        "reference": ("<u8", behind + 8),
    }
    if end:
        fields["end_transform"] = (("<f4", numbers), end)
    return np.dtype(
        {
            "names": list(fields),
            "formats": [form for form, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": 160,
        }
    )


# The records of the types STATIC, MATRIX_MOTION and SRT_MOTION, by their numbers.
MOTION_INSTANCES = (
    _motion_instance((3, 4), 0),
    _motion_instance((3, 4), 56),
    _motion_instance((16,), 72),
)
