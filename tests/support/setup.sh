# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=sh disable=SC2034
# setup.sh - what ./demo and ./check need before they start. Sourced by them, with the repository's root as the working directory.
#
# Packages are looked up with dpkg first, so that a machine that has them needs neither network nor rights.

# Numbers and messages as the scripts expect them.
export LC_ALL=C

setup_build_packages="gcc libc6-dev meson ninja-build pkg-config libassimp-dev libcjson-dev libssl-dev libpng-dev libvulkan-dev glslang-tools libprotobuf-c-dev protobuf-c-compiler libuv1-dev libsystemd-dev"
setup_bench_packages="cmake libembree-dev gnuplot-nox"
setup_check_packages="$setup_build_packages $setup_bench_packages g++ clang libclang-rt-dev libcmocka-dev systemd"

setup_say()
{
    printf '%s\n' "$*"
}

setup_fail()
{
    printf '%s: %s\n' "${0##*/}" "$*" >&2
    exit 1
}

# VERSION_ID of this Debian, such as 12; empty elsewhere.
setup_debian()
{
    sed -n 's/^VERSION_ID="\{0,1\}\([0-9]*\).*/\1/p' /etc/os-release 2>/dev/null
}

# Which of the packages named are not installed.
setup_missing()
{
    for package; do
        dpkg-query -W -f '${Status}\n' "$package" 2>/dev/null | grep -q ' installed$' || printf '%s ' "$package"
    done
}

# Runs a command as root: directly, or through sudo.
setup_as_root()
{
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    elif command -v sudo >/dev/null; then
        sudo "$@"
    else
        setup_fail "needs root for: $*"
    fi
}

# Installs what is missing of the packages named, by apt.
setup_packages()
{
    if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
        setup_say "This is no Debian: the following must be there already: $*"
        return 0
    fi
    missing=$(setup_missing "$@")
    if [ -z "$missing" ]; then
        setup_say "Packages: all there."
        return 0
    fi
    setup_say "Packages to install by apt: $missing"
    setup_as_root apt-get update -q || setup_say "apt-get update failed; going on with the lists that are there."
    # shellcheck disable=SC2086 # a list of words
    setup_as_root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends $missing
}

# setup_configure DIR MESON-OPTION... - a build folder; one that exists stays as it is.
setup_configure()
{
    folder=$1
    shift
    [ -f "$folder/build.ninja" ] || meson setup "$folder" "$@"
}

. tests/support/setup_vulkan.sh
