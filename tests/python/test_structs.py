# SPDX-License-Identifier: Apache-2.0
"""Tests that the package's structs and numbers are those of the C headers.

A C program, compiled by $BVHD_CC against the headers of $BVHD_CFLAGS, prints the same table.
"""
import ctypes
import enum
import os
import shlex
import subprocess
import tempfile
import unittest

import bvhd
from bvhd import _library, _structs

HEADERS = ["bvhd/bvhd.h", "bvhd/bvhd_cpu.h", "bvhd/bvhd_scene.h", "bvhd/vulkan_nv.h"]

# The C names of the package's structs, and the prefixes of its enumerators.
STRUCTS = {
    _structs.Error: "struct bvhd_error",
    _structs.Key: "struct bvhd_key",
    _structs.ClientOptions: "struct bvhd_client_options",
    _structs.CacheState: "struct bvhd_cache_state",
    _structs.Connection: "struct bvhd_connection",
    _structs.Format: "struct bvhd_format",
    _structs.Reference: "struct bvhd_reference",
    _structs.Build: "struct bvhd_build",
    _structs.Result: "struct bvhd_result",
    _structs.CpuBlob: "struct bvhd_cpu_blob",
    _structs.CpuSceneOptions: "struct bvhd_cpu_scene_options",
    _structs.CpuTrace: "struct bvhd_cpu_trace",
    _structs.SceneStructure: "struct bvhd_scene_structure",
    _structs.TrianglesData: "VkAccelerationStructureGeometryTrianglesDataKHR",
    _structs.MotionTrianglesData: "VkAccelerationStructureGeometryMotionTrianglesDataNV",
    _structs.AabbsData: "VkAccelerationStructureGeometryAabbsDataKHR",
    _structs.InstancesData: "VkAccelerationStructureGeometryInstancesDataKHR",
    _structs.SpheresData: "VkAccelerationStructureGeometrySpheresDataNV",
    _structs.SweptSpheresData: "VkAccelerationStructureGeometryLinearSweptSpheresDataNV",
    _structs.GeometryData: "VkAccelerationStructureGeometryDataKHR",
    _structs.Geometry: "VkAccelerationStructureGeometryKHR",
    _structs.BuildInfo: "VkAccelerationStructureBuildGeometryInfoKHR",
    _structs.Range: "VkAccelerationStructureBuildRangeInfoKHR",
}
ENUMS = {
    bvhd.Status: "BVHD_{}",
    bvhd.Local: "BVHD_LOCAL_{}",
    bvhd.Quality: "BVHD_QUALITY_{}",
    bvhd.CacheAction: "BVHD_CACHE_{}",
    bvhd.Target: "BVHD_TARGET_{}",
    bvhd.Priority: "BVHD_PRIORITY_{}",
    bvhd.Origin: "BVHD_ORIGIN_{}",
    bvhd.LayoutFlags: "BVHD_PORTABLE_{}",
    bvhd.BuildFlags: "VK_BUILD_ACCELERATION_STRUCTURE_{}_BIT_KHR",
    bvhd.GeometryFlags: "VK_GEOMETRY_{}_BIT_KHR",
    bvhd.InstanceFlags: "VK_GEOMETRY_INSTANCE_{}_BIT_KHR",
    bvhd.IndexingMode: "VK_RAY_TRACING_LSS_INDEXING_MODE_{}_NV",
    bvhd.EndCaps: "VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_{}_NV",
    bvhd.RayFlags: "BVHD_CPU_RAY_{}",
    bvhd.HitFlags: "BVHD_CPU_HIT_{}",
    bvhd.VertexFormat: "VK_FORMAT_{}",
}


# Flags that Vulkan's headers of Debian 12 lack.
NEWER = {"ALLOW_DATA_ACCESS"}

# Flags that have another suffix than most.
NVIDIA = {"MOTION"}


def has_c_name(member: enum.IntEnum) -> bool:
    return not (isinstance(member, enum.IntFlag) and (member == 0 or member.name in NEWER))


def rows():
    """The table as this package has it: a C expression and its value."""
    for struct, name in STRUCTS.items():
        yield f"sizeof({name})", ctypes.sizeof(struct)
        for field, *_ in struct._fields_:
            yield f"offsetof({name}, {field})", getattr(struct, field).offset
            yield f"sizeof((({name} *)0)->{field})", getattr(struct, field).size
    for dtype, name in (
        (_structs.RAY, "struct bvhd_cpu_ray"),
        (_structs.HIT, "struct bvhd_cpu_hit"),
    ):
        yield f"sizeof({name})", dtype.itemsize
        for field, (_, offset) in dtype.fields.items():
            yield f"offsetof({name}, {field})", offset
    for kind, pattern in ENUMS.items():
        for member in kind:
            if has_c_name(member):
                name = pattern.format(member.name)
                yield name.replace("KHR", "NV") if member.name in NVIDIA else name, int(member)
    yield "BVHD_STATUS_COUNT", len(bvhd.Status)
    yield "sizeof(VkAccelerationStructureInstanceKHR)", _structs.INSTANCE.itemsize
    offset = _structs.INSTANCE.fields["reference"][1]
    yield "offsetof(VkAccelerationStructureInstanceKHR, accelerationStructureReference)", offset
    record = "VkAccelerationStructureMotionInstanceNV"
    kinds = (
        ("staticInstance.transform", ""),
        ("matrixMotionInstance.transformT0", "matrixMotionInstance.transformT1"),
        ("srtMotionInstance.transformT0", "srtMotionInstance.transformT1"),
    )
    for kind, (start, end) in enumerate(kinds):
        fields = _structs.MOTION_INSTANCES[kind].fields
        reference = start.split(".", maxsplit=1)[0] + ".accelerationStructureReference"
        yield f"offsetof({record}, data.{start})", fields["transform"][1]
        yield f"offsetof({record}, data.{reference})", fields["reference"][1]
        if end:
            yield f"offsetof({record}, data.{end})", fields["end_transform"][1]


class StructsTest(unittest.TestCase):
    def test_c_agrees(self):
        table = dict(rows())
        self.assertGreater(len(table), 150)
        with tempfile.TemporaryDirectory() as folder:
            source = os.path.join(folder, "table.c")
            program = os.path.join(folder, "table")
            with open(source, "w", encoding="ascii") as file:
                file.write("#include <stdio.h>\n")
                file.writelines(f"#include <{header}>\n" for header in HEADERS)
                file.write("int main(void)\n{\n")
                file.writelines(f'    printf("%lld\\n", (long long)({name}));\n' for name in table)
                file.write("    return 0;\n}\n")
            compiler = shlex.split(os.environ["BVHD_CC"]) + shlex.split(os.environ["BVHD_CFLAGS"])
            subprocess.run([*compiler, source, "-o", program], check=True)
            output = subprocess.run([program], check=True, stdout=subprocess.PIPE, text=True).stdout
        values = [int(line) for line in output.split()]
        wrong = {
            name: (table[name], value) for name, value in zip(table, values) if table[name] != value
        }
        self.assertEqual(wrong, {}, "here, and in C")
        self.assertEqual(len(values), len(table))

    def test_functions_are_exported(self):
        for name in _library.FUNCTIONS:
            self.assertTrue(hasattr(_library.lib, name), name)


if __name__ == "__main__":
    unittest.main()
