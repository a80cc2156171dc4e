# SPDX-License-Identifier: Apache-2.0
"""Containers: files in which `bvhctl build SCENE -o scene.bvhd` puts all structures of a scene."""
from __future__ import annotations

import ctypes as c
import json
import os
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from . import _structs as s
from ._enums import Target
from ._errors import check
from ._handle import Handle
from ._library import lib
from .geometry import Reference

_LAZY = 0x1


class _Bytes:
    """Bytes of a container, which stays open as long as an array shows them."""

    def __init__(self, container: Container, data: int, size: int) -> None:
        self._container = container
        self.__array_interface__ = {
            "version": 3,
            "typestr": "|u1",
            "shape": (size,),
            "data": (data, True),
        }


class Structure:
    """One structure of a container."""

    def __init__(self, container: Container, struct: s.SceneStructure) -> None:
        #: The serialized acceleration structure: read only and not copied.
        self.array: npt.NDArray[np.uint8] = np.asarray(_Bytes(container, struct.data, struct.size))
        self.key = bytes(struct.key.bytes)
        self.target = Target(struct.target)
        self.is_top_level = struct.type == 0
        #: Its name as a file; the name of the mesh or node; the name of the scene.
        self.file: str = struct.file.decode()
        self.name: str = struct.name.decode()
        self.scene: str = struct.scene.decode()
        self.bounds = np.array(struct.bounds, np.float32)
        self.slabs = np.array(struct.slabs, np.float32)
        self.moves = bool(struct.moves)
        self._reference = Reference(self.key, self.bounds, self.slabs, self.moves)
        #: Of a top level: the numbers of the structures that it names, by rows.
        self.bottoms: list[int] = struct.bottoms[: struct.bottom_count]

    @property
    def data(self) -> memoryview:
        return self.array.data

    @property
    def handle(self) -> int:
        """The number by which instances name the structure."""
        return self._reference.handle

    def reference(self) -> Reference:
        """Returns what a top level needs of this structure."""
        return self._reference


class Container:
    """An open container. Its file is mapped, and closed when nothing shows its bytes any more.

    With is_lazy the checksums of structures are not compared; `check` compares one of them.
    """

    def __init__(self, path: Union[str, os.PathLike[str]], *, is_lazy: bool = False) -> None:
        pointer, error = c.c_void_p(), s.Error()
        flags = _LAZY if is_lazy else 0
        check(lib.bvhd_scene_open(os.fsencode(path), flags, pointer, error), error)
        self._handle = Handle(pointer, lib.bvhd_scene_close)
        with self._handle as scene:
            self.structures = [
                Structure(self, lib.bvhd_scene_get_structure(scene, index).contents)
                for index in range(lib.bvhd_scene_structure_count(scene))
            ]
            #: The numbers of the top levels, one for each scene.
            self.tops = [
                int(lib.bvhd_scene_top(scene, index))
                for index in range(lib.bvhd_scene_top_count(scene))
            ]
            size = c.c_uint64()
            text = lib.bvhd_scene_manifest(scene, size)
            #: The manifest, as docs/manifest.md describes it.
            self.manifest: Any = json.loads(c.string_at(text, size.value))

    def rows(self, top: int = 0) -> list[Structure]:
        """Returns the bottom levels of a scene in the order of rows, and last its top level."""
        structure = self.structures[self.tops[top]]
        return [self.structures[bottom] for bottom in structure.bottoms] + [structure]

    def check(self, index: int) -> None:
        """Compares the bytes of a structure with their checksum; raises CORRUPT."""
        error = s.Error()
        with self._handle as scene:
            check(lib.bvhd_scene_check(scene, index, error), error)
