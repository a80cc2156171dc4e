#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# debian_package.sh FOLDER - builds the Debian packages of the committed tree in a fresh Debian 12 below FOLDER, tests
# that lintian finds nothing to say about them and that every source is compiled with the options that bvhd and Debian
# need, and leads them through a package's life (package_life.sh) in another fresh one. Both systems are removed
# afterwards. It needs root, git, debootstrap and unshare. The packages stay in FOLDER/packages.
set -eu
suite=bookworm
folder=$1
root=$folder/package-build
life=$folder/package-life
# shellcheck source=tests/support/fresh_debian.sh
. "$(dirname "$0")/fresh_debian.sh"

# Unpacks the committed tree for the build, and the same without debian/ as the upstream source.
copy_sources()
{
    version=$(sed -n '1s/.*(\(.*\)).*/\1/p' debian/changelog)
    source=$root/build/bvhd-${version%-*}
    mkdir -p "$source"
    git archive HEAD | tar -x -C "$source"
    git archive --prefix="bvhd-${version%-*}/" -o "$root/build/bvhd_${version%-*}.orig.tar.gz" HEAD . ':!debian'
}

# with_version VERSION DEB FOLDER - writes the package with another version into the folder.
with_version()
{
    content=$folder/package-content
    rm -rf "$content"
    dpkg-deb -R "$2" "$content"
    sed -i "s/$version/$1/" "$content/DEBIAN/control"
    dpkg-deb --root-owner-group -b "$content" "$3" >/dev/null
    rm -rf "$content"
}

# Every compiler's command ends with the options that keep the bytes, and has those of Debian.
check_options()
{
    commands=$(find "$source" -name compile_commands.json)
    grep '"command"' "$commands" >"$root/commands"
    for option in -ffp-contract=off -fno-fast-math -O3 -D_FORTIFY_SOURCE=2 -fstack-protector-strong; do
        ! grep -v -e " $option " "$root/commands" || { echo "compiled without $option"; return 1; }
    done
    ! grep -E -e '-ffast-math|-ffp-contract=(fast|on)|-march=' "$root/commands"
}

fresh_needs git dpkg-deb
# shellcheck disable=SC2119 # no packages
fresh_make
rm -rf --one-file-system "$life"
trap 'rm -rf --one-file-system "$root" "$life"' EXIT
cp -a "$root" "$life"
copy_sources
inside 'apt-get update -q && apt-get install -q -y --no-install-recommends build-essential lintian'
inside "cd '/build/${source##*/}' && apt-get -q -y --no-install-recommends build-dep ./ &&
    DEB_BUILD_OPTIONS='noautodbgsym parallel=$(nproc)' dpkg-buildpackage -us -uc"
check_options
inside 'cd /build && lintian --allow-root --info --fail-on error,warning ./*.changes'
inside 'cd /build && lintian --allow-root --fail-on info,warning,error ./*.deb \
    --tags hardening-no-bindnow,hardening-no-pie,hardening-no-relro,hardening-no-fortify-functions'

rm -rf "$folder/packages"
mkdir -p "$folder/packages" "$life/root/packages" "$life/root/newer" "$life/root/support"
cp "$root"/build/*.deb "$folder/packages/"
cp "$folder"/packages/*.deb "$life/root/packages/"
cp tests/support/package_life.sh tests/support/expect.sh "$life/root/support/"
for package in "$folder"/packages/*.deb; do
    with_version "$version+newer" "$package" "$life/root/newer"
done
fresh_run "$life" 'apt-get update -q && /root/support/package_life.sh /root/packages /root/newer'
