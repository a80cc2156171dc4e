/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/options_table.h"

const struct option_row option_rows[] = {
    {"output", 'o', "PATH", ON_BUILD,
     "a directory, for manifest.json and one .as file for each structure; or, if it ends with .bvhd, one file with all "
     "of it"},
    {"output", 'o', "DIR", ON_UPDATE,
     "where to write (default: where it was built); with --frames a directory for each of them, DIR/0000 and so on"},
    {"output", 'o', "PNG", ON_TRACE, "the picture to write"},
    {"output", 'o', "FILE", ON_GET, "the file to write"},
    {"output", 'o', "FILE", ON_PROBE, "the file to write, for 'bvhctl build --probe'"},
    {"depfile", OPTION_DEPFILE, "FILE", ON_BUILD,
     "also write a make rule for manifest.json or the .bvhd file, with the files that the scenes were read from"},
    {"target", OPTION_TARGET, "NAME", ON_BUILD,
     "portable (default): for shaders on any device; lavapipe: for ray queries of that driver, in the version of this "
     "machine or in that of --probe"},
    {"probe", OPTION_PROBE, "FILE", ON_BUILD | ON_UPDATE,
     "a file of 'bvhctl probe': build for the device that it describes; without --target, for the target that this "
     "device loads"},
    {"probe", OPTION_PROBE, "FILE", ON_QUERY,
     "a file of 'bvhctl probe': say whether the device that it describes loads the structure"},
    {"compact", OPTION_COMPACT, NULL, ON_COPY,
     "copy by Vulkan's mode COMPACT, of a structure built with allow-compaction (default: CLONE, all bytes)"},
    {"quality", OPTION_QUALITY, "NAME", ON_BUILD, "fast, balanced, high or auto (default: by --flags, else auto)"},
    {"builder", OPTION_BUILDER, "NAME", ON_BUILD,
     "own (default), or embree: Embree's LOW, MEDIUM and HIGH as fast, balanced and high, where there is Embree"},
    {"flags", OPTION_FLAGS, "LIST", ON_BUILD,
     "allow-update, allow-compaction, prefer-fast-trace, prefer-fast-build, low-memory, allow-data-access; separated "
     "by commas"},
    {"layout", OPTION_LAYOUT, "LIST", ON_BUILD,
     "fast-triangles: three float4 for each triangle, larger but faster to trace"},
    {"geometry-flags", OPTION_GEOMETRY_FLAGS, "LIST", ON_BUILD, "opaque (default), no-duplicate-any-hit, none"},
    {"rays", OPTION_RAYS, "N", ON_BUILD,
     "expected rays for each primitive, by which the quality auto chooses; without it, auto is balanced"},
    {"deadline", OPTION_DEADLINE, "MS", ON_BUILD | ON_UPDATE,
     "milliseconds after which structures that are requested, but not built, are cancelled (default: no limit)"},
    {"rays", OPTION_RAYS, "N", ON_CHECK, "number of rays to trace (default 4000, as many as the time allows)"},
    {"time", OPTION_TIME, "SEC", ON_CHECK,
     "seconds after which brute force stops; what it has not judged is counted (default: no limit with --rays, else "
     "60)"},
    {"seed", OPTION_SEED, "S", ON_CHECK, "seed of the random rays (default 1)"},
    {"flip-order", OPTION_FLIP_ORDER, NULL, ON_CHECK,
     "visit children in the opposite order; the answers must be the same"},
    {"scene", OPTION_SCENE, "NAME|NUMBER", ON_BUILD | ON_CHECK | ON_TRACE,
     "one scene of a glTF file, by its name or its number from 0: build builds only it, check and trace take what was "
     "built from it; in a directory of several files they also take a file's name without ending (default: all scenes; "
     "trace: the first file)"},
    {"points", OPTION_POINTS, "RADIUS", ON_BUILD,
     "read points as spheres; RADIUS is that of points for which the file has none (default: points are left out)"},
    {"lines", OPTION_LINES, "RADIUS", ON_BUILD,
     "read lines as linear swept spheres; RADIUS is that of ends for which the file has none (default: lines are left "
     "out)"},
    {"frames", OPTION_FRAMES, "A:B:STEP", ON_UPDATE,
     "update to each moment from A to B, in steps of so many seconds; without -o the last one stays"},
    {"decay", OPTION_DECAY, "FACTOR", ON_UPDATE,
     "build a structure when its update costs rays more than this many times what it did after the last build "
     "(default: where building pays for the rays that the build expected, or for one a primitive; balanced: 1.7)"},
    {"at", OPTION_AT, "SEC", ON_BUILD | ON_UPDATE,
     "read glTF files at this moment of an animation, with skins and morph targets (default: at rest, without them; "
     "update: as it was built)"},
    {"shutter", OPTION_SHUTTER, "T0:T1", ON_BUILD | ON_UPDATE,
     "read glTF files over the time from T0 to T1 seconds, while the shutter of a camera is open: what moves is built "
     "as "
     "motion triangles and motion instances (update: as it was built)"},
    {"animation", OPTION_ANIMATION, "NAME|NUMBER", ON_BUILD | ON_UPDATE,
     "of --at, --shutter and --frames: the animation, by its name or its number from 0 (default: the first of the "
     "file)"},
    {"device", OPTION_DEVICE, "NAME", ON_TRACE,
     "cpu, a Vulkan device's number or a part of its name, or auto: a GPU that loads the structures, else cpu"},
    {"device", OPTION_DEVICE, "NAME", ON_PROBE,
     "its number or a part of its name, as 'bvhctl devices' prints them, or auto (default): the first of them"},
    {"size", OPTION_SIZE, "WxH", ON_TRACE, "width and height of the picture (default 1280x720)"},
    {"up", OPTION_UP, "AXIS", ON_TRACE, "the axis that points up: x, y, z or auto (default)"},
    {"eye", OPTION_EYE, "X,Y,Z", ON_TRACE, "where the camera is (default: where most can be seen from)"},
    {"look-at", OPTION_LOOK_AT, "X,Y,Z", ON_TRACE,
     "what is in the middle of the picture (default: the middle of the scene)"},
    {"fov", OPTION_FOV, "DEGREES", ON_TRACE,
     "the vertical angle of view, 0.1 to 170 (default: 34, or 60 inside a room)"},
    {"turn", OPTION_TURN, "N", ON_TRACE,
     "N pictures from all around what the camera looks at, named PNG-0000.png and so on"},
    {"samples", OPTION_SAMPLES, "N", ON_TRACE,
     "samples of each pixel, 1 to 1024 (default 4, and 9 more on edges; where something moves 8 and 24)"},
    {"times", OPTION_TIMES, "A:B", ON_TRACE,
     "when rays meet what moves, from 0 (the start of its motion) to 1 (the end): each sample has a time from A to B, "
     "so that it is blurred; A alone is one moment (default 0:1)"},
    {"all", OPTION_ALL, NULL, ON_CLIENTS,
     "fail unless the connections of all users may be seen, which needs root or the user whom the daemon runs as"},
    {"count", OPTION_COUNT, "N", ON_TOP, "look N times (default: until it is interrupted)"},
    {"interval", OPTION_INTERVAL, "SEC", ON_TOP, "seconds between two looks (default 2)"},
    {"threads", OPTION_THREADS, "N", ON_BUILD | ON_UPDATE | ON_CHECK | ON_TRACE,
     "number of threads of this process (default: one for each processor); a daemon has its own"},
    {"memory", OPTION_MEMORY, "BYTES", ON_SCENES,
     "limit for geometry and results, beyond which the command fails; K, M, G may follow the number"},
    {"cache", OPTION_CACHE, "DIR", ON_BUILD | ON_UPDATE,
     "keep results in this directory, with --local or by the private daemon that is started (default: "
     "$XDG_CACHE_HOME/bvhd, without that variable ~/.cache/bvhd)"},
    {"cache", OPTION_CACHE, "DIR", ON_CACHE,
     "look at this directory (default: that of the daemon on --socket or of your private one; else "
     "$XDG_CACHE_HOME/bvhd, or ~/.cache/bvhd)"},
    {"no-cache", OPTION_NO_CACHE, NULL, ON_BUILD | ON_UPDATE,
     "keep no results on disk and use none, with --local or by the private daemon that is started"},
    {"disk-cache-size", OPTION_DISK_CACHE_SIZE, "BYTES", ON_BUILD | ON_UPDATE,
     "the most that the directory holds (default 10G); K, M, G may follow the number"},
    {"disk-cache-size", OPTION_DISK_CACHE_SIZE, "BYTES", ON_CACHE,
     "trim: the most that is left (default 10G); K, M, G may follow the number"},
    {"json", OPTION_JSON, NULL, ON_ALL | ON_MAIN, "print the result as one JSON object"},
    {"local", OPTION_LOCAL, NULL, ON_BUILD | ON_UPDATE | ON_MAIN, "build in this process, without a daemon"},
    {"socket", OPTION_SOCKET, "PATH", ON_BUILD | ON_UPDATE | ON_MAIN,
     "the daemon's socket (default: $BVHD_SOCKET; without it that of a running daemon; if there is none, build starts "
     "a private daemon)"},
    {"socket", OPTION_SOCKET, "PATH", ON_QUERIES & ~ON_STOP,
     "the daemon's socket (default: $BVHD_SOCKET; without it that of a running daemon)"},
    {"socket", OPTION_SOCKET, "PATH", ON_STOP,
     "the daemon's socket (default: $BVHD_SOCKET; without it that of your private daemon)"},
    {"local", OPTION_LOCAL, NULL, ON_CACHE, "look at the user's own directory, and ask no daemon"},
    {"socket", OPTION_SOCKET, "PATH", ON_CACHE,
     "the daemon to ask (default: $BVHD_SOCKET; without it your private daemon, if it runs)"},
    {"local", OPTION_LOCAL, NULL, ON_ALONE, "has no effect: this command never uses a daemon"},
    {"socket", OPTION_SOCKET, "PATH", ON_ALONE, "has no effect: this command never uses a daemon"},
    {"connect-timeout", OPTION_CONNECT_TIMEOUT, "SEC", ON_SERVICE | ON_MAIN,
     "seconds to wait for a daemon (default 5)"},
    {"help", 'h', NULL, ON_ALL | ON_MAIN, "print this help"},
    {"quiet", 'q', NULL, ON_ALL | ON_MAIN, "print errors only: no remarks, no progress, no summary"},
    {"verbose", 'v', NULL, ON_ALL | ON_MAIN, "print more: steps, times, and progress also where stderr is no terminal"},
    {"version", OPTION_VERSION, NULL, ON_ALL | ON_MAIN, "print the version"},
    {NULL, 0, NULL, 0, NULL},
};

_Static_assert(sizeof option_rows / sizeof *option_rows <= OPTION_ROWS_MOST, "room in tables of options");

const struct command_row command_rows[COMMAND_COUNT] = {
    [COMMAND_BUILD] = {"build", "SCENE... -o DIR", "build acceleration structures from scene files", 1, 1 << 20},
    [COMMAND_UPDATE] = {"update", "DIR SCENE", "update structures that were built with --flags allow-update", 2, 2},
    [COMMAND_CHECK] = {"check", "DIR SCENE", "check built files against brute force over their scene", 2, 2},
    [COMMAND_INSPECT] = {"inspect", "PATH", "describe a built file or a probe, or all files of a directory", 1, 1},
    [COMMAND_TRACE] = {"trace", "DIR [SCENE] --device NAME -o PNG", "render a picture of built structures", 1, 2},
    [COMMAND_COPY] = {"copy", "FILE.as FILE.as", "copy a built file, after all of it was checked", 2, 2},
    [COMMAND_QUERY] = {"query", "FILE.as",
                       "print Vulkan's properties of a built file: sizes, references, compatibility", 1, 1},
    [COMMAND_GET] = {"get", "KEY -o FILE", "fetch a structure from the daemon, by its key", 1, 1},
    [COMMAND_STATS] = {"stats", "", "print the daemon's counters", 0, 0},
    [COMMAND_CLIENTS] = {"clients", "", "list who uses the daemon, and what each client holds", 0, 0},
    [COMMAND_TOP] = {"top", "", "watch what the daemon does, and for whom", 0, 0},
    [COMMAND_PING] = {"ping", "", "ask whether a daemon answers", 0, 0},
    [COMMAND_STOP] = {"stop", "", "end your private daemon, or the one on --socket", 0, 0},
    [COMMAND_CACHE] = {"cache", "show|trim|clear",
                       "say what is kept on disk, remove what was not used for long, or all", 1, 1},
    [COMMAND_DEVICES] = {"devices", "", "list the Vulkan devices of this machine, and what they load", 0, 0},
    [COMMAND_PROBE] = {"probe", "--device NAME -o FILE",
                       "find out what a device loads, for builds on machines without it", 0, 0},
};

const struct name_value build_flag_names[] = {
    {"allow-update", BUILD_ALLOW_UPDATE},
    {"allow-compaction", BUILD_ALLOW_COMPACTION},
    {"prefer-fast-trace", BUILD_PREFER_FAST_TRACE},
    {"prefer-fast-build", BUILD_PREFER_FAST_BUILD},
    {"low-memory", BUILD_LOW_MEMORY},
    {"allow-data-access", BUILD_ALLOW_DATA_ACCESS},
    {NULL, 0},
};

const struct name_value geometry_flag_names[] = {
    {"opaque", GEOMETRY_OPAQUE},
    {"no-duplicate-any-hit", GEOMETRY_NO_DUPLICATE_ANY_HIT},
    {"none", 0},
    {NULL, 0},
};

const struct name_value layout_flag_names[] = {
    {"fast-triangles", PORTABLE_FAST_TRIANGLES},
    {NULL, 0},
};

const struct name_value quality_names[] = {
    {"fast", QUALITY_FAST}, {"balanced", QUALITY_BALANCED}, {"high", QUALITY_HIGH}, {"auto", QUALITY_AUTO}, {NULL, 0},
};

const struct name_value builder_names[] = {{"own", BUILDER_OWN}, {"embree", BUILDER_EMBREE}, {NULL, 0}};

const struct name_value target_names[] = {
    {"portable", TARGET_PORTABLE},
    {"lavapipe", TARGET_LAVAPIPE},
    {NULL, 0},
};

const struct name_value axis_names[] = {{"auto", 0}, {"x", 'x'}, {"y", 'y'}, {"z", 'z'}, {NULL, 0}};

const struct name_value cache_action_names[] = {
    {"show", CACHE_SHOW}, {"trim", CACHE_TRIM}, {"clear", CACHE_CLEAR}, {NULL, 0}};

const struct name_value device_names[] = {{"cpu", 0}, {"auto", 0}, {NULL, 0}};
