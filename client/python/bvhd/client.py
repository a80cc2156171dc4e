# SPDX-License-Identifier: Apache-2.0
"""Clients, batches and results."""
from __future__ import annotations

import ctypes as c
import os
import time
import weakref
from typing import Any, Callable, Iterator, Optional, Sequence, Union, overload

import numpy as np
import numpy.typing as npt

from . import _structs as s
from ._enums import (
    Builder,
    CacheAction,
    LayoutFlags,
    Local,
    Origin,
    Priority,
    Quality,
    Status,
    Target,
)
from ._errors import Error, check, error_from
from ._handle import Handle
from ._library import CALLBACK, lib
from .geometry import (
    _STYPE_BUILD,
    _STYPE_GEOMETRY,
    GEOMETRIES,
    BottomLevel,
    Geometry,
    Reference,
    Structure,
    TopLevel,
    as_structure,
)

_MODE_UPDATE = 1  # VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR

# Waits are cut into slices, so that Ctrl-C interrupts them.
_SLICE_MS = 100


class Blob:
    """The bytes of a result. Views of them, by `data` or numpy, keep them alive."""

    def __init__(self, pointer: int) -> None:
        self._handle = Handle(c.c_void_p(lib.bvhd_blob_ref(pointer)), lib.bvhd_blob_unref)
        with self._handle as blob:
            self._data: int = lib.bvhd_blob_data(blob)
            self._size: int = lib.bvhd_blob_size(blob)

    def __len__(self) -> int:
        return self._size

    @property
    def __array_interface__(self) -> dict[str, Any]:
        return {"version": 3, "typestr": "|u1", "shape": (self._size,), "data": (self._data, True)}


class Result:
    """A structure that was built: its bytes, its key, and what is known of it."""

    def __init__(self, result: s.Result) -> None:
        blob = Blob(result.blob)
        #: The serialized acceleration structure as a read-only array of bytes, which is not copied.
        self.array: npt.NDArray[np.uint8] = np.asarray(blob)
        #: 32 bytes, by which the service finds the structure again. Keep it as secret as the bytes.
        self.key = bytes(result.key.bytes)
        self.origin = Origin(result.origin)
        self.target = Target(result.target)
        self.quality = Quality(result.quality)
        self.method: str = (result.method or b"").decode()
        #: The minimum and the maximum, 6 numbers.
        self.bounds = np.array(result.bounds, np.float32)
        #: The bounds along ten more directions, 20 numbers.
        self.slabs = np.array(result.slabs, np.float32)
        #: Numbers about the build, by the names of their fields in bvhd.h.
        self.statistics: dict[str, float] = {
            field[0]: getattr(result, field[0])
            for field in s.Result._fields_
            if field[1] in (c.c_uint64, c.c_double, c.c_uint32) and field[0] != "size"
        }
        #: It has motion triangles, or is a top level that moves.
        self.moves = bool(result.moves)
        self._reference = Reference(self.key, self.bounds, self.slabs, self.moves)

    @property
    def data(self) -> memoryview:
        """The bytes, read only and not copied. They live as long as the view."""
        return self.array.data

    @property
    def size(self) -> int:
        return len(self.array)

    @property
    def handle(self) -> int:
        """The number by which instances name the structure."""
        return self._reference.handle

    def reference(self) -> Reference:
        """Returns what a top level needs of this structure, without its bytes."""
        return self._reference

    def __bytes__(self) -> bytes:
        return self.array.tobytes()

    def __len__(self) -> int:
        return self.size

    def __repr__(self) -> str:
        target = self.target.name.lower()
        return f"<bvhd.Result of {self.size} bytes, {target}, key {self.key.hex()[:16]}...>"


class _Request:
    """A struct bvhd_build with all that it points to."""

    def __init__(self, structures: Sequence[Structure]) -> None:
        count = len(structures)
        self.arrays: list[Any] = []  # the geometry's memory
        self.infos = (s.BuildInfo * count)()
        self.ranges = (c.POINTER(s.Range) * count)()
        self.references = self._references(structures)
        self._structs = [self._fill(i, structure) for i, structure in enumerate(structures)]
        self.build = s.Build(
            struct_size=c.sizeof(s.Build),
            info_count=count,
            infos=self.infos,
            ranges=self.ranges,
            references=self.references,
            reference_count=len(self.references),
        )

    def _fill(self, i: int, structure: Structure) -> Any:
        info = self.infos[i]
        top = isinstance(structure, TopLevel)
        geometries: Sequence[Any] = [structure] if top else structure.geometries  # type: ignore
        structs = (s.Geometry * len(geometries))()
        extents = (s.Range * len(geometries))()
        for geometry, struct, extent in zip(geometries, structs, extents):
            struct.sType = _STYPE_GEOMETRY
            struct.flags = geometry.geometry_flags if top else geometry.flags
            self.arrays += geometry._fill(struct, extent)
        info.sType = _STYPE_BUILD
        info.type = 0 if top else 1
        info.flags = structure.flags
        info.dstAccelerationStructure = structure.handle
        if structure.source is not None:
            info.mode = _MODE_UPDATE
            info.srcAccelerationStructure = structure.source.handle
        info.geometryCount = len(geometries)
        info.pGeometries = structs
        self.ranges[i] = c.cast(extents, c.POINTER(s.Range))
        return structs, extents

    @staticmethod
    def _references(structures: Sequence[Structure]) -> Any:
        named: dict[int, Reference] = {}
        own = {structure.handle for structure in structures}
        for structure in structures:
            if structure.source is not None:
                source = _reference_of(structure.source)
                named[source.handle] = source
            if isinstance(structure, TopLevel):
                for below in structure.structures:
                    # Bottom levels of this batch are named by the handles of their infos.
                    if isinstance(below, BottomLevel):
                        if below.handle not in own:
                            raise ValueError("a top level names a bottom level of another batch")
                        continue
                    reference = _reference_of(below)
                    named[reference.handle] = reference
        references = (s.Reference * len(named))()
        for struct, reference in zip(references, named.values()):
            reference._fill(struct)
        return references


def _reference_of(value: Any) -> Reference:
    reference: Reference = value if isinstance(value, Reference) else value.reference()
    return reference


class Batch:
    """Structures that were requested together. Leaving it as a context cancels what is not done."""

    def __init__(self, client: Client, pointer: c.c_void_p, arrays: list[Any]) -> None:
        self._callbacks: list[Any] = []
        callbacks = self._callbacks

        def destroy(batch: c.c_void_p) -> None:
            lib.bvhd_batch_destroy(batch)
            arrays.clear()  # which lived until now, whoever held the call off
            callbacks.clear()

        self._handle = Handle(pointer, destroy, client._handle)
        self._arrays = arrays
        self._count: int = lib.bvhd_batch_count(pointer)

    def __len__(self) -> int:
        return self._count

    def __enter__(self) -> Batch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Cancels what is not done, and frees the batch. Results live on."""
        if self._handle.is_open:
            self.cancel()
            self._handle.close()
            self._arrays.clear()

    def cancel(self, item: Optional[int] = None) -> None:
        """Cancels one item, or all, that have no result yet. Their error is then CANCELLED."""
        with self._handle as batch:
            if item is None:
                lib.bvhd_batch_cancel(batch)
            else:
                lib.bvhd_batch_cancel_item(batch, item)

    @property
    def is_copied(self) -> bool:
        """Whether the arrays of the request may be changed."""
        with self._handle as batch:
            if not lib.bvhd_batch_is_copied(batch):
                return False
        self._arrays.clear()
        return True

    @property
    def is_done(self) -> bool:
        with self._handle as batch:
            return bool(lib.bvhd_batch_is_done(batch))

    def progress(self, item: int = 0) -> float:
        """Returns how far an item is, from 0 to 1, as far as it is known."""
        with self._handle as batch:
            return float(lib.bvhd_batch_progress(batch, item))

    def wait(self, timeout: Optional[float] = None) -> bool:
        """Waits at most `timeout` seconds, and returns whether every item has its result."""
        return self._wait(lib.bvhd_batch_wait, timeout)

    def wait_copied(self, timeout: Optional[float] = None) -> bool:
        """Waits at most `timeout` seconds, and returns `is_copied`."""
        return self._wait(lib.bvhd_batch_wait_copied, timeout) and self.is_copied

    def _wait(self, function: Any, timeout: Optional[float]) -> bool:
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            left = _SLICE_MS if end is None else max(0, round((end - time.monotonic()) * 1000))
            with self._handle as batch:
                if function(batch, min(left, _SLICE_MS)) == Status.OK:
                    return True
            if left == 0:
                return False

    def set_callback(self, callback: Callable[[Batch], object]) -> None:
        """Has callback(batch) called once, when every item has its result, by cancelling too.

        It is called by `Client.dispatch` and by calls that wait, on their threads. Its exceptions
        go to sys.unraisablehook. If the batch is closed before, or is gone, it is not called.
        """
        own = weakref.ref(self)

        def call(_batch: Optional[int], _user: Optional[int]) -> None:
            batch = own()
            if batch is not None:
                callback(batch)

        function = CALLBACK(call)
        self._callbacks.append(function)
        with self._handle as pointer:
            lib.bvhd_batch_set_callback(pointer, function, None)

    def error(self, item: int) -> Optional[Error]:
        """Returns the error of an item, PENDING if it is not done, or None if it has a result."""
        with self._handle as batch:
            error = self._struct(batch, item).error
            return None if error.status == Status.OK else error_from(error)

    def result(self, item: int = 0) -> Result:
        """Returns the result of an item, or raises its error, PENDING if it is not done."""
        with self._handle as batch:
            struct = self._struct(batch, item)
            if struct.error.status != Status.OK:
                raise error_from(struct.error)
            return Result(struct)

    def results(self) -> list[Result]:
        """Waits, and returns all results or raises the first error."""
        self.wait()
        return [self.result(item) for item in range(self._count)]

    def __iter__(self) -> Iterator[Result]:
        return iter(self.results())

    def _struct(self, batch: c.c_void_p, item: int) -> s.Result:
        if not 0 <= item < self._count:
            raise IndexError(f"item {item} of a batch of {self._count}")
        struct: s.Result = lib.bvhd_batch_result(batch, item).contents
        return struct


class Client:
    """Asks the service for structures. It connects when it is needed. Any thread may use it."""

    def __init__(
        self,
        socket_path: Union[str, os.PathLike[str], None] = None,
        *,
        connect_timeout: float = 0.0,
        lost_after: float = 0.0,
        pool_size: int = 0,
        local: Local = Local.IF_NO_DAEMON,
        local_threads: Optional[int] = None,
    ) -> None:
        """Times are in seconds; 0 stands for the defaults, which bvhd.h has.

        Structures are built in this process as `local` says, by at most local_threads threads of
        the library; by default one for each processor. With 0 the threads that wait build them, and
        Ctrl-C ends a wait only between two structures.
        """
        options = s.ClientOptions(
            struct_size=c.sizeof(s.ClientOptions),
            socket_path=None if socket_path is None else os.fsencode(socket_path),
            connect_timeout_ms=round(connect_timeout * 1000),
            lost_after_ms=round(lost_after * 1000),
            pool_size=pool_size,
            local=local,
            local_threads=(os.cpu_count() or 1) if local_threads is None else local_threads,
        )
        pointer, error = c.c_void_p(), s.Error()
        check(lib.bvhd_client_create(options, pointer, error), error)
        self._handle = Handle(pointer, lib.bvhd_client_destroy)
        self._batches: weakref.WeakSet[Batch] = weakref.WeakSet()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes all batches and the connection. Results live on."""
        for batch in list(self._batches):
            batch.close()
        self._handle.close()

    def connect(self) -> None:
        """Waits until the daemon has answered; raises UNAVAILABLE or INCOMPATIBLE."""
        error = s.Error()
        with self._handle as client:
            check(lib.bvhd_client_connect(client, error), error)

    def ping(self, timeout: Optional[float] = None) -> float:
        """Returns the seconds until an empty request was answered."""
        error, milliseconds = s.Error(), c.c_double()
        with self._handle as client:
            check(lib.bvhd_client_ping(client, _milliseconds(timeout), milliseconds, error), error)
        return milliseconds.value / 1000

    def _counters(self, timeout: Optional[float]) -> Handle:
        error, counters = s.Error(), c.c_void_p()
        with self._handle as client:
            check(lib.bvhd_client_counters(client, _milliseconds(timeout), counters, error), error)
        return Handle(counters, lib.bvhd_counters_destroy)

    def counters(self, timeout: Optional[float] = None) -> dict[str, int]:
        """Returns the service's counters by name."""
        with self._counters(timeout) as counters:
            return {
                lib.bvhd_counters_name(counters, i).decode(): lib.bvhd_counters_value(counters, i)
                for i in range(lib.bvhd_counters_count(counters))
            }

    def daemon_version(self, timeout: Optional[float] = None) -> str:
        """Returns the version of the daemon, such as "0.1.0"; "" if it does not say."""
        with self._counters(timeout) as counters:
            version: bytes = lib.bvhd_counters_version(counters)
            return version.decode()

    def connections(
        self, everyone: bool = False, timeout: Optional[float] = None
    ) -> list[dict[str, Union[int, str]]]:
        """Returns the service's connections, by the names of struct bvhd_connection's members.

        Root and the user who runs the daemon see all of them, others those of their own user. With
        `everyone`, UNSUPPORTED is raised if that leaves some out.
        """
        error, pointer = s.Error(), c.c_void_p()
        with self._handle as client:
            wait = _milliseconds(timeout)
            check(lib.bvhd_client_connections(client, everyone, wait, pointer, error), error)
        with Handle(pointer, lib.bvhd_connections_destroy) as connections:
            count = lib.bvhd_connections_count(connections)
            rows = [lib.bvhd_connections_get(connections, i).contents for i in range(count)]
            values = [{name: getattr(row, name) for name, _ in row._fields_} for row in rows]
        return [{**value, "software": value["software"].decode()} for value in values]

    def cache(
        self,
        action: CacheAction = CacheAction.SHOW,
        size: int = 0,
        timeout: Optional[float] = None,
    ) -> dict[str, Union[int, str]]:
        """Returns what the service keeps, by the names of struct bvhd_cache_state's members.

        TRIM first removes the least recently used results on disk until at most `size` bytes are
        left; CLEAR removes all results. Only root and the user who runs the daemon may do either.
        """
        error, pointer = s.Error(), c.c_void_p()
        with self._handle as client:
            wait = _milliseconds(timeout)
            check(lib.bvhd_client_cache(client, action, size, wait, pointer, error), error)
        with Handle(pointer, lib.bvhd_cache_state_destroy) as state:
            row = c.cast(state, c.POINTER(s.CacheState)).contents
            values = {field[0]: getattr(row, field[0]) for field in row._fields_}
        return {**values, "directory": os.fsdecode(values["directory"])}

    def fileno(self) -> int:
        """Returns a descriptor for event loops: when it is readable, call `dispatch`."""
        with self._handle as client:
            return int(lib.bvhd_client_descriptor(client))

    def dispatch(self) -> None:
        """Does all work that is possible without blocking."""
        with self._handle as client:
            lib.bvhd_client_dispatch(client)

    def submit(
        self,
        structures: Sequence[Union[Structure, Geometry]],
        *,
        quality: Quality = Quality.UNSPECIFIED,
        priority: Priority = Priority.NORMAL,
        format: Optional[Format] = None,
        layout_flags: LayoutFlags = LayoutFlags.NONE,
        rays_per_primitive: float = 0.0,
        deadline: Optional[float] = None,
        builder: Builder = Builder.OWN,
    ) -> Batch:
        """Requests structures and returns without waiting for them.

        A geometry that comes alone is a bottom level of its own. With a format the structures are
        native to its driver, else portable. Structures that have no result `deadline` seconds from
        now are cancelled; their error is then CANCELLED with the place "deadline".
        """
        request = _Request([as_structure(structure) for structure in structures])
        build = request.build
        build.quality = quality
        build.priority = priority
        build.layout_flags = layout_flags
        build.rays_per_primitive = rays_per_primitive
        build.deadline_ms = 0 if deadline is None else max(1, round(deadline * 1000))
        build.builder = builder
        if format is not None:
            build.format = c.pointer(format._struct)
        pointer, error = c.c_void_p(), s.Error()
        with self._handle as client:
            check(lib.bvhd_batch_submit(client, build, pointer, error), error)
            return self._batch(pointer, request.arrays)

    def fetch(self, keys: Sequence[bytes]) -> Batch:
        """Requests structures that were built before, by the keys of their results."""
        structs = (s.Key * len(keys))()
        for struct, key in zip(structs, keys):
            if len(key) != s.KEY_SIZE:
                raise ValueError(f"a key of {len(key)} bytes instead of {s.KEY_SIZE}")
            struct.bytes[:] = key
        pointer, error = c.c_void_p(), s.Error()
        with self._handle as client:
            check(lib.bvhd_batch_fetch(client, len(keys), structs, pointer, error), error)
            return self._batch(pointer, [])

    def _batch(self, pointer: c.c_void_p, arrays: list[Any]) -> Batch:
        batch = Batch(self, pointer, arrays)
        self._batches.add(batch)
        return batch

    @overload
    def build(self, structures: Union[Structure, Geometry], **options: Any) -> Result:
        ...

    @overload
    def build(
        self, structures: Sequence[Union[Structure, Geometry]], **options: Any
    ) -> list[Result]:
        ...

    def build(self, structures: Any, **options: Any) -> Any:
        """Requests one structure, or several, and waits. Options are those of `submit`.

        Returns the result, or the list of results; raises the first error.
        """
        one = isinstance(structures, (*GEOMETRIES, BottomLevel, TopLevel))
        with self.submit([structures] if one else structures, **options) as batch:
            results = batch.results()
        return results[0] if one else results


class Format:
    """The native format of a device, by the bytes of `bvhctl probe` or bvhd_vulkan_probe."""

    def __init__(self, probe: Union[bytes, bytearray, memoryview]) -> None:
        data = bytes(probe)
        self._struct, error = s.Format(), s.Error()
        check(lib.bvhd_format_from_probe(data, len(data), self._struct, error), error)

    @property
    def target(self) -> Target:
        return Target(self._struct.target)

    @property
    def variant(self) -> int:
        return int(self._struct.variant)


def _milliseconds(timeout: Optional[float]) -> int:
    return -1 if timeout is None else max(0, round(timeout * 1000))
