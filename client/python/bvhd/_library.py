# SPDX-License-Identifier: Apache-2.0
"""Finds libbvhd, loads it, and declares the functions that the package calls."""
from __future__ import annotations

import ctypes as c
import os
import sys
from typing import Any

from . import _structs as s

SONAME = "libbvhd.so.0"

_ERROR = c.POINTER(s.Error)
_HANDLE = c.c_void_p
_RET_HANDLE = c.POINTER(c.c_void_p)

CALLBACK = c.CFUNCTYPE(None, c.c_void_p, c.c_void_p)

# The functions: their results, then their arguments.
FUNCTIONS: dict[str, tuple[Any, ...]] = {
    "bvhd_batch_cancel": (None, _HANDLE),
    "bvhd_batch_cancel_item": (None, _HANDLE, c.c_uint32),
    "bvhd_batch_count": (c.c_uint32, _HANDLE),
    "bvhd_batch_destroy": (None, _HANDLE),
    "bvhd_batch_fetch": (c.c_int, _HANDLE, c.c_uint32, c.POINTER(s.Key), _RET_HANDLE, _ERROR),
    "bvhd_batch_is_copied": (c.c_int, _HANDLE),
    "bvhd_batch_is_done": (c.c_int, _HANDLE),
    "bvhd_batch_progress": (c.c_float, _HANDLE, c.c_uint32),
    "bvhd_batch_result": (c.POINTER(s.Result), _HANDLE, c.c_uint32),
    "bvhd_batch_set_callback": (None, _HANDLE, CALLBACK, c.c_void_p),
    "bvhd_batch_submit": (c.c_int, _HANDLE, c.POINTER(s.Build), _RET_HANDLE, _ERROR),
    "bvhd_batch_wait": (c.c_int, _HANDLE, c.c_int),
    "bvhd_batch_wait_copied": (c.c_int, _HANDLE, c.c_int),
    "bvhd_blob_data": (c.c_void_p, _HANDLE),
    "bvhd_blob_ref": (c.c_void_p, _HANDLE),
    "bvhd_blob_size": (c.c_uint64, _HANDLE),
    "bvhd_blob_unref": (None, _HANDLE),
    "bvhd_client_connect": (c.c_int, _HANDLE, _ERROR),
    "bvhd_cache_state_destroy": (None, _HANDLE),
    "bvhd_client_cache": (c.c_int, _HANDLE, c.c_int, c.c_uint64, c.c_int, _RET_HANDLE, _ERROR),
    "bvhd_client_connections": (c.c_int, _HANDLE, c.c_uint32, c.c_int, _RET_HANDLE, _ERROR),
    "bvhd_client_counters": (c.c_int, _HANDLE, c.c_int, _RET_HANDLE, _ERROR),
    "bvhd_client_create": (c.c_int, c.POINTER(s.ClientOptions), _RET_HANDLE, _ERROR),
    "bvhd_client_descriptor": (c.c_int, _HANDLE),
    "bvhd_client_destroy": (None, _HANDLE),
    "bvhd_client_dispatch": (None, _HANDLE),
    "bvhd_client_ping": (c.c_int, _HANDLE, c.c_int, c.POINTER(c.c_double), _ERROR),
    "bvhd_connections_count": (c.c_uint32, _HANDLE),
    "bvhd_connections_destroy": (None, _HANDLE),
    "bvhd_connections_get": (c.POINTER(s.Connection), _HANDLE, c.c_uint32),
    "bvhd_counters_count": (c.c_uint32, _HANDLE),
    "bvhd_counters_destroy": (None, _HANDLE),
    "bvhd_counters_name": (c.c_char_p, _HANDLE, c.c_uint32),
    "bvhd_counters_value": (c.c_uint64, _HANDLE, c.c_uint32),
    "bvhd_counters_version": (c.c_char_p, _HANDLE),
    "bvhd_cpu_scene_bounds": (None, _HANDLE, c.POINTER(c.c_float)),
    "bvhd_cpu_scene_create": (c.c_int, c.POINTER(s.CpuSceneOptions), _RET_HANDLE, _ERROR),
    "bvhd_cpu_scene_destroy": (None, _HANDLE),
    "bvhd_cpu_scene_positions": (
        c.c_int,
        _HANDLE,
        c.c_uint32,
        c.c_uint32,
        c.c_uint32,
        c.POINTER(c.c_float),
        _ERROR,
    ),
    "bvhd_cpu_scene_positions_at": (
        c.c_int,
        _HANDLE,
        c.c_uint32,
        c.c_uint32,
        c.c_uint32,
        c.c_float,
        c.POINTER(c.c_float),
        _ERROR,
    ),
    "bvhd_cpu_scene_trace": (c.c_int, _HANDLE, c.POINTER(s.CpuTrace), _ERROR),
    "bvhd_format_from_probe": (c.c_int, c.c_void_p, c.c_uint64, c.POINTER(s.Format), _ERROR),
    "bvhd_scene_check": (c.c_int, _HANDLE, c.c_uint32, _ERROR),
    "bvhd_scene_close": (None, _HANDLE),
    "bvhd_scene_manifest": (c.c_void_p, _HANDLE, c.POINTER(c.c_uint64)),
    "bvhd_scene_open": (c.c_int, c.c_char_p, c.c_uint32, _RET_HANDLE, _ERROR),
    "bvhd_scene_get_structure": (c.POINTER(s.SceneStructure), _HANDLE, c.c_uint32),
    "bvhd_scene_structure_count": (c.c_uint32, _HANDLE),
    "bvhd_scene_top": (c.c_uint32, _HANDLE, c.c_uint32),
    "bvhd_scene_top_count": (c.c_uint32, _HANDLE),
    "bvhd_version": (c.c_char_p,),
    "bvhd_vuid_string": (c.c_char_p, c.c_int),
}


def _load() -> c.CDLL:
    """Loads the library that $BVHD_LIBRARY names, else the one that the dynamic linker finds.

    A prefix of its own, such as that of a virtual environment, is searched last.
    """
    named = os.environ.get("BVHD_LIBRARY")
    if named:
        return c.CDLL(named)
    tried = []
    for path in (SONAME, os.path.join(sys.prefix, "lib", SONAME)):
        try:
            return c.CDLL(path)
        except OSError as error:
            tried.append(str(error))
    raise ImportError(
        "bvhd: libbvhd was not found (" + "; ".join(tried) + "). Install bvhd's library, or set"
        " BVHD_LIBRARY to the path of " + SONAME + " or LD_LIBRARY_PATH to its folder."
    )


def _declare(library: c.CDLL) -> c.CDLL:
    for name, (result, *arguments) in FUNCTIONS.items():
        function = getattr(library, name)
        function.restype = result
        function.argtypes = arguments
    return library


lib = _declare(_load())
