# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=sh disable=SC2034 # the script that sources this uses the variables
# installed.sh - the start of shell tests of the installed library, which source it with their arguments SOURCE BUILD
# COMPILER... It sets $source, $build and $compiler, and enters a folder by scratch.sh.
export LC_ALL=C
source=$(realpath "$1")
build=$(realpath "$2")
shift 2
compiler=$*
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"
unset XDG_RUNTIME_DIR PKG_CONFIG_SYSROOT_DIR

# install_library - installs the build below $scratch/stage, and sets $config to its file for pkg-config and $prefix to
# its prefix there.
install_library()
{
    meson install -C "$build" --no-rebuild --destdir "$scratch/stage" || return 1
    config=$(find "$scratch/stage" -name bvhd.pc)
    [ -f "$config" ] || return 1
    prefix=$scratch/stage$(sed -n 's/^prefix=//p' "$config")
}

# pkg OPTION... - asks pkg-config about the installed library.
pkg()
{
    PKG_CONFIG_PATH=$(dirname "$config") pkg-config --define-variable=prefix="$prefix" "$@" bvhd
}
