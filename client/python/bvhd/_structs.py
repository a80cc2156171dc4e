# SPDX-License-Identifier: Apache-2.0
"""The structs of bvhd.h and of Vulkan's host builds, for ctypes, and numpy's types for arrays."""
from __future__ import annotations

import ctypes as c

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
    ]


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
