#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# clean_debian.sh SUITE FOLDER - runs ./demo and ./check of the committed tree in a fresh Debian SUITE (bookworm,
# trixie), which debootstrap makes below FOLDER and which is removed afterwards. It needs root, git, debootstrap and
# unshare. The packages come from where this machine gets its own. Mounts are made in a namespace that ends with the
# run.
set -eu
suite=$1
root=$2/clean-$suite

# mirror PATTERN - prints the first archive in this machine's own apt sources, in any format, that has Debian's main
# component of a release whose name matches.
mirror()
{
    # shellcheck disable=SC2016 # apt fills these in
    apt-get indextargets --format '$(REPO_URI)|$(COMPONENT)|$(CODENAME)|$(ORIGIN)' 'Created-By: Packages' |
        awk -F'|' -v pattern="$1" '$2 == "main" && $3 ~ pattern && ($4 ~ /^Debian/ || $4 == "") { print $1; exit }'
}

releases='^[a-z]+$'

# resolve ADDRESS - prints the first mirror of a mirror list, or any other address unchanged.
resolve()
{
    case $1 in
    mirror+file:*) awk '!/^#/ && NF { print $1; exit }' "${1#mirror+file:}" ;;
    *) echo "$1" ;;
    esac
}

# Copies what apt and the resolver need to reach the archive in the way that this machine does.
copy_network_settings()
{
    cp -L /etc/resolv.conf "$root/etc/resolv.conf"
    apt-config dump | grep -Ei '^Acquire::(.*::)?(Proxy|Retries|Check-)' >"$root/etc/apt/apt.conf.d/99outside" || :
    if [ -d /usr/local/share/ca-certificates ]; then
        mkdir -p "$root/usr/local/share"
        cp -RL /usr/local/share/ca-certificates "$root/usr/local/share/"
        chroot "$root" update-ca-certificates >/dev/null 2>&1 || :
    fi
}

# If this machine gets backports from another archive than the rest, writes that to the fresh system. Otherwise the
# system has to find them by itself.
copy_backports()
{
    backports=$(resolve "$(mirror "^$suite-backports\$")")
    if [ -n "$backports" ] && [ "${backports%/}" != "${url%/}" ]; then
        echo "deb $backports $suite-backports main" >"$root/etc/apt/sources.list.d/backports.list"
    fi
}

# inside COMMAND - runs the command in the fresh system, without this machine's environment.
inside()
{
    # shellcheck disable=SC2016 # the inner shell fills these in
    unshare --mount --pid --fork --kill-child sh -eu -c '
        mount --make-rprivate /
        mount -t proc proc "$1/proc"
        mount -t sysfs -o ro sysfs "$1/sys"
        mount --rbind /dev "$1/dev"
        exec chroot "$1" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 sh -euc "$2"' \
        sh "$root" "$1"
}

[ "$(id -u)" -eq 0 ] || { echo "clean_debian: needs root" >&2; exit 1; }
for tool in debootstrap unshare git; do
    command -v "$tool" >/dev/null || { echo "clean_debian: needs $tool" >&2; exit 1; }
done
[ -n "$(mirror "$releases")" ] || apt-get update -q
url=$(resolve "$(mirror "$releases")")
[ -n "$url" ] || { echo "clean_debian: found no Debian archive in apt's sources" >&2; exit 1; }

rm -rf --one-file-system "$root"
trap 'rm -rf --one-file-system "$root"' EXIT
trap 'exit 1' HUP INT TERM
mkdir -p "$root"
debootstrap --variant=minbase --include=git,ca-certificates "$suite" "$root" "$url"
copy_network_settings
copy_backports
git clone --quiet . "$root/root/bvhd"
inside 'cd /root/bvhd && ./demo && ./check'
