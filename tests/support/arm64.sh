#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# arm64.sh FOLDER BUILD - builds the committed tree for arm64 in a fresh Debian 12 below FOLDER, which is removed
# afterwards, runs the unit tests in an emulator, except those of the suite `kernel`, and tests that structures of
# generated scenes have the same bytes as from BUILD, a build for this machine with make_scene, bvhctl and determinism.
# It needs root, git, debootstrap and unshare. SIZE is the number of primitives in a scene (2000).
set -eu
suite=bookworm
root=$1/arm64
build=$(realpath "$2")
size=${SIZE:-2000}
# shellcheck source=tests/support/setup.sh
. "$(dirname "$0")/setup.sh"
# shellcheck source=tests/support/fresh_debian.sh
. "$(dirname "$0")/fresh_debian.sh"

# Prints the names of the packages for a build, libraries with their architecture.
packages()
{
    # shellcheck disable=SC2086 # lists of words
    printf '%s\n' gcc-aarch64-linux-gnu qemu-user-static python3 libcmocka-dev $setup_build_packages |
        sed -e '/^gcc$/d' -e '/^libembree-dev$/d' -e '/^lib.*-dev$/s/$/:arm64/' | tr '\n' ' '
}

# digests RUNNER BUILD SCENES OUT - a script that prints the digest of all files that bvhctl writes for each scene and
# quality, and that of determinism.
digests()
{
    cat <<END
export XDG_CACHE_HOME=$4.cache
for quality in fast balanced high; do
    for scene in $3/*; do
        rm -rf "$4"
        $1 $2/client/bvhctl/bvhctl --local build "\$scene" -o "$4" --threads 2 --quality \$quality >"$4.log" 2>&1 ||
            { cat "$4.log" >&2; exit 1; }
        echo "\${scene##*/} \$quality \$(cd "$4" && find . -type f ! -name '*.d' | LC_ALL=C sort | xargs sha256sum |
            sha256sum)"
    done
done
echo "determinism \$($1 $2/tests/integration/determinism --digest 100 1)"
END
}

fresh_needs git
# shellcheck disable=SC2119 # no packages
fresh_make
inside "dpkg --add-architecture arm64 && apt-get update -q &&
    apt-get install -q -y --no-install-recommends $(packages)"
mkdir -p "$root/root/bvhd" "$root/root/scenes"
git archive HEAD | tar -x -C "$root/root/bvhd"
inside 'cd /root/bvhd && meson setup --cross-file tests/support/arm64.ini --werror -Dembree=disabled \
    -Ddevelopment=disabled /root/build'
inside 'meson test -C /root/build --suite unit --no-suite vulkan --no-suite kernel \
    --timeout-multiplier 10 --print-errorlogs'
echo "The tests of the suite kernel, which an emulator cannot answer, did not run:"
inside 'meson test -C /root/build --suite kernel --list'

make_scene=$build/tests/support/make_scene
for name in $("$make_scene" --list); do
    "$make_scene" "$name" --size "$size" -o "$root/root/scenes/$name.ply" >/dev/null
done
inside 'ninja -C /root/build client/bvhctl/bvhctl tests/integration/determinism'
inside "$(digests qemu-aarch64-static /root/build /root/scenes /root/out)" >"$root/arm64.digests"
sh -euc "$(digests '' "$build" "$root/root/scenes" "$root/native-out")" >"$root/native.digests"
echo "$(wc -l <"$root/native.digests") digests from this machine and from arm64"
diff "$root/native.digests" "$root/arm64.digests"
