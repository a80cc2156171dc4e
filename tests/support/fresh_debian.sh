# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=sh disable=SC2154 # the script that sources this sets $suite and $root
# fresh_debian.sh - functions that make a fresh Debian in a folder and run commands in it, for scripts that source it
# with the release in $suite and the folder in $root. They need root, debootstrap and unshare. The packages come from
# where this machine gets its own. Mounts are made in a namespace that ends with each command, and no system manager is
# ever started.

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

# fresh_needs TOOL... - ends the script with a message unless it runs as root and has the tools.
fresh_needs()
{
    [ "$(id -u)" -eq 0 ] || { echo "${0##*/}: needs root" >&2; exit 1; }
    for tool in debootstrap unshare "$@"; do
        command -v "$tool" >/dev/null || { echo "${0##*/}: needs $tool" >&2; exit 1; }
    done
}

# fresh_make [PACKAGE,...] - makes the fresh system with these packages, and removes it when the script ends. Packages
# that are installed into it start nothing.
fresh_make()
{
    [ -n "$(mirror "$releases")" ] || apt-get update -q
    url=$(resolve "$(mirror "$releases")")
    [ -n "$url" ] || { echo "${0##*/}: found no Debian archive in apt's sources" >&2; exit 1; }
    rm -rf --one-file-system "$root"
    trap 'rm -rf --one-file-system "$root"' EXIT
    trap 'exit 1' HUP INT TERM
    mkdir -p "$root"
    debootstrap --variant=minbase --include="ca-certificates${1:+,$1}" "$suite" "$root" "$url"
    copy_network_settings
    copy_backports
    printf '#!/bin/sh\nexit 101\n' >"$root/usr/sbin/policy-rc.d"
    chmod 755 "$root/usr/sbin/policy-rc.d"
}

# fresh_run ROOT COMMAND - runs the command in the system below ROOT, without this machine's environment.
fresh_run()
{
    # shellcheck disable=SC2016 # the inner shell fills these in
    unshare --mount --pid --fork --kill-child sh -eu -c '
        mount --make-rprivate /
        mount -t proc proc "$1/proc"
        mount -t sysfs -o ro sysfs "$1/sys"
        mount --rbind /dev "$1/dev"
        exec chroot "$1" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 \
            DEBIAN_FRONTEND=noninteractive sh -euc "$2"' \
        sh "$1" "$2"
}

# inside COMMAND - runs the command in the fresh system.
inside()
{
    fresh_run "$root" "$1"
}
