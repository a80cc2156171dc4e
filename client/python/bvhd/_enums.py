# SPDX-License-Identifier: Apache-2.0
"""The numbers of bvhd.h and of Vulkan, by name."""
from __future__ import annotations

import enum


class Status(enum.IntEnum):
    """The outcome of a call or of a build: enum bvhd_status."""

    OK = 0
    INVALID = 1
    UNSUPPORTED = 2
    TOO_LARGE = 3
    NO_MEMORY = 4
    CANCELLED = 5
    CORRUPT = 6
    NOT_FOUND = 7
    BUSY = 8
    UNAVAILABLE = 9
    INCOMPATIBLE = 10
    IO = 11
    INTERNAL = 12
    PENDING = 13
    SOURCE_LOST = 14

    @classmethod
    def _missing_(cls, value: object) -> Status:
        """A newer library may have statuses that this package does not know."""
        return cls.INTERNAL


class Local(enum.IntEnum):
    """Whether a client builds structures in this process: enum bvhd_local."""

    IF_NO_DAEMON = 0
    NEVER = 1
    ALWAYS = 2


class Quality(enum.IntEnum):
    """How much time to spend on a structure: enum bvhd_quality."""

    UNSPECIFIED = 0
    FAST = 1
    BALANCED = 2
    HIGH = 3
    AUTO = 4


class Builder(enum.IntEnum):
    """Whose methods build the trees: enum bvhd_builder."""

    OWN = 0
    EMBREE = 1


class CacheAction(enum.IntEnum):
    """What to do with the results that the service keeps: enum bvhd_cache_action."""

    SHOW = 0
    TRIM = 1
    CLEAR = 2


class Target(enum.IntEnum):
    """The formats in which structures are written: enum bvhd_target."""

    PORTABLE = 1
    LAVAPIPE = 2


class Priority(enum.IntEnum):
    """The order of the batches of one client: enum bvhd_priority."""

    LOW = -1
    NORMAL = 0
    HIGH = 1


class Origin(enum.IntEnum):
    """Where a result came from: enum bvhd_origin."""

    NONE = 0
    BUILT = 1
    COALESCED = 2
    MEMORY = 3
    DISK = 4


class LayoutFlags(enum.IntFlag):
    """Variants of the portable layout."""

    NONE = 0
    FAST_TRIANGLES = 0x1


class BuildFlags(enum.IntFlag):
    """VkBuildAccelerationStructureFlagBitsKHR."""

    NONE = 0
    ALLOW_UPDATE = 0x1
    ALLOW_COMPACTION = 0x2
    PREFER_FAST_TRACE = 0x4
    PREFER_FAST_BUILD = 0x8
    LOW_MEMORY = 0x10
    MOTION = 0x20
    ALLOW_DATA_ACCESS = 0x800


class GeometryFlags(enum.IntFlag):
    """VkGeometryFlagBitsKHR."""

    NONE = 0
    OPAQUE = 0x1
    NO_DUPLICATE_ANY_HIT_INVOCATION = 0x2


class InstanceFlags(enum.IntFlag):
    """VkGeometryInstanceFlagBitsKHR."""

    NONE = 0
    TRIANGLE_FACING_CULL_DISABLE = 0x1
    TRIANGLE_FLIP_FACING = 0x2
    FORCE_OPAQUE = 0x4
    FORCE_NO_OPAQUE = 0x8


class IndexingMode(enum.IntEnum):
    """Which vertices are the ends of a swept sphere: VkRayTracingLssIndexingModeNV."""

    LIST = 0
    SUCCESSIVE = 1


class EndCaps(enum.IntEnum):
    """Which ends of swept spheres are closed: VkRayTracingLssPrimitiveEndCapsModeNV."""

    NONE = 0
    CHAINED = 1


class RayFlags(enum.IntFlag):
    """SPIR-V's flags of a ray."""

    NONE = 0
    OPAQUE = 0x1
    NO_OPAQUE = 0x2
    TERMINATE_ON_FIRST_HIT = 0x4
    CULL_BACK_FACING = 0x10
    CULL_FRONT_FACING = 0x20
    CULL_OPAQUE = 0x40
    CULL_NO_OPAQUE = 0x80
    SKIP_TRIANGLES = 0x100
    SKIP_AABBS = 0x200


class HitFlags(enum.IntFlag):
    """What a hit is."""

    NONE = 0
    FRONT_FACE = 0x1
    AABB = 0x2
    SPHERE = 0x4
    SWEPT_SPHERE = 0x8


class VertexFormat(enum.IntEnum):
    """The VkFormats in which positions may come."""

    R8G8_UNORM = 16
    R8G8_SNORM = 17
    R8G8B8_SNORM = 24
    R8G8B8A8_UNORM = 37
    R8G8B8A8_SNORM = 38
    A2B10G10R10_UNORM_PACK32 = 64
    R16G16_UNORM = 77
    R16G16_SNORM = 78
    R16G16_SFLOAT = 83
    R16G16B16_SNORM = 85
    R16G16B16_SFLOAT = 90
    R16G16B16A16_UNORM = 91
    R16G16B16A16_SNORM = 92
    R16G16B16A16_SFLOAT = 97
    R32G32_SFLOAT = 103
    R32G32B32_SFLOAT = 106
    R32G32B32A32_SFLOAT = 109
    R64G64_SFLOAT = 115
    R64G64B64_SFLOAT = 118
    R64G64B64A64_SFLOAT = 121

    @property
    def size(self) -> int:
        """The bytes of a vertex that are read, or a few more where a fourth component is not."""
        bits = {"R8": 8, "R16": 16, "R32": 32, "R64": 64}
        first = self.name.split("G")[0]
        if first not in bits:
            return 4
        return bits[first] // 8 * sum(letter in self.name.split("_")[0] for letter in "RGBA")
