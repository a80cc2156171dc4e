# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=sh disable=SC2034
# setup.sh - installs what ./demo and ./check need before they start. They source it, with the repository's root as
# the working directory.
#
# It first looks up packages with dpkg, so that a machine that has them needs neither a network nor root.

# The scripts parse numbers and messages of the C locale.
export LC_ALL=C

setup_client_packages="gcc libc6-dev meson ninja-build pkg-config libvulkan-dev glslang-tools \
libprotobuf-c-dev protobuf-c-compiler libssl-dev"
setup_build_packages="$setup_client_packages libassimp-dev libcjson-dev libmeshoptimizer-dev \
libjpeg-dev libpng-dev libuv1-dev libsystemd-dev libxxhash-dev libembree-dev"
setup_bench_packages="cmake gnuplot-nox"
setup_check_packages="$setup_build_packages $setup_bench_packages g++ clang lld libclang-rt-dev libcmocka-dev systemd \
python3-numpy python3-pip python3-setuptools python3-wheel mypy groff-base mandoc make"

setup_say()
{
    printf '%s\n' "$*"
}

setup_fail()
{
    printf '%s: %s\n' "${0##*/}" "$*" >&2
    exit 1
}

# Prints the VERSION_ID of this Debian, such as 12, and nothing on other systems.
setup_debian()
{
    sed -n 's/^VERSION_ID="\{0,1\}\([0-9]*\).*/\1/p' /etc/os-release 2>/dev/null
}

# setup_missing PACKAGE... - prints the packages that are not installed.
setup_missing()
{
    for package; do
        dpkg-query -W -f '${Status}\n' "$package" 2>/dev/null | grep -q ' installed$' || printf '%s ' "$package"
    done
}

# setup_as_root COMMAND... - runs a command as root, directly or through sudo.
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

# setup_packages PACKAGE... - installs the missing ones with apt.
setup_packages()
{
    if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
        setup_say "This is not Debian; the following packages must be installed already: $*"
        return 0
    fi
    missing=$(setup_missing "$@")
    if [ -z "$missing" ]; then
        setup_say "Packages: all are installed."
        return 0
    fi
    setup_say "Packages to install with apt: $missing"
    setup_as_root apt-get update -q || setup_say "apt-get update failed; continuing with the present package lists."
    # shellcheck disable=SC2086 # a list of words
    setup_as_root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends $missing
}

# setup_configure DIR MESON-OPTION... - configures a build folder. An existing one stays unchanged.
setup_configure()
{
    folder=$1
    shift
    [ -f "$folder/build.ninja" ] || meson setup "$folder" "$@"
}

. tests/support/setup_vulkan.sh
