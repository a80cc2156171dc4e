#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# package_life.sh PACKAGES NEWER - tests the Debian packages in the folder PACKAGES in a fresh system: installs them,
# has the daemon started by its socket, builds, upgrades to the same packages with a higher version in the folder NEWER
# while the daemon runs, removes and purges them. It prints each expectation that does not hold, and its status is 1 if
# there is one. It changes the system that it runs in: debian_package.sh runs it in one that is thrown away.
#
# There is no system manager. systemd-socket-activate does what it would do for the socket; what packages ask of it is
# recorded, and denied.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/expect.sh"
packages=$(realpath "$1")
newer=$(realpath "$2")
socket=/run/bvhd/bvhd.sock
units=/lib/systemd/system
requests=/root/requests
scratch=/root/life
daemon=
mkdir -p "$scratch"
cd "$scratch" || exit 1

apt()
{
    apt-get -q -y --no-install-recommends "$@"
}

# Forgets the requests so far.
from_now()
{
    : >"$requests"
}

asked()
{
    grep -qx -e "$1" "$requests"
}

not()
{
    ! "$@"
}

# Packages ask a manager to start and stop units where this folder is. They get these programs instead. Of systemctl
# only the links in /etc remain, for which it needs no manager.
record_requests()
{
    mkdir -p /run/systemd/system
    cat >/usr/sbin/policy-rc.d <<END
#!/bin/sh
echo "\$*" >>$requests
exit 101
END
    dpkg-divert --quiet --local --rename --divert /bin/systemctl.real --add /bin/systemctl
    cat >/bin/systemctl <<END
#!/bin/sh
echo "systemctl \$*" >>$requests
case " \$* " in
*' preset '* | *' enable '*) SYSTEMD_OFFLINE=1 exec /bin/systemctl.real "\$@" ;;
esac
END
    chmod 755 /usr/sbin/policy-rc.d /bin/systemctl
    from_now
}

# Prints the names of all files but those of the test and of the package manager.
files()
{
    find / -xdev \( -path /root -o -path /home -o -path /tmp -o -path /var/lib/dpkg -o -path /var/lib/apt \
        -o -path /var/cache/apt -o -path /var/log \) -prune -o -print | sort
}

# unit_value UNIT NAME - prints what the unit gives the name.
unit_value()
{
    sed -n "s/^$2=//p" "$units/$1"
}

# Makes the folders that systemd makes for the service.
make_folders()
{
    for pair in CacheDirectory:/var/cache StateDirectory:/var/lib; do
        name=$(unit_value bvhd.service "${pair%%:*}")
        [ -z "$name" ] || install -d -m 0700 -o bvhd -g bvhd "${pair#*:}/$name"
    done
}

# Prints the service's command, with what systemd fills in.
service_command()
{
    unit_value bvhd.service ExecStart | sed -e 's|%C|/var/cache|g' -e 's|%S|/var/lib|g' \
        -e "s|\${CACHE_DIRECTORY}|/var/cache/bvhd|g" -e "s|\${STATE_DIRECTORY}|/var/lib/bvhd|g"
}

# Listens as bvhd.socket says. The first client starts the daemon, as the service's user, in the same process.
listen()
{
    make_folders
    # shellcheck disable=SC2016,SC2046 # the inner shell fills in; the command is a list of words
    systemd-socket-activate --listen="$socket" setpriv --reuid bvhd --regid bvhd --init-groups --no-new-privs \
        sh -c 'umask "$0" && exec "$@"' "$(unit_value bvhd.service UMask)" $(service_command) >>daemon.log 2>&1 &
    daemon=$!
    for _ in $(seq 100); do
        [ -S "$socket" ] && break
        sleep 0.1
    done
    chgrp "$(unit_value bvhd.socket SocketGroup)" "$socket"
    chmod "$(unit_value bvhd.socket SocketMode)" "$socket"
}

# Ends the daemon and the socket as systemd does when their units stop.
stop()
{
    [ -n "$daemon" ] || return 0
    kill "$daemon"
    wait "$daemon"
    ended=$?
    daemon=
    rm -f "$socket"
    return $ended
}
trap stop EXIT

# as USER COMMAND...
as()
{
    user=$1
    shift
    setpriv --reuid "$user" --regid "$user" --init-groups \
        env -i HOME="/home/$user" PATH=/usr/bin:/bin LANG=C.UTF-8 "$@"
}

# served FOLDER - the member builds by the service.
served()
{
    as member bvhctl --socket "$socket" build /home/member/scene.obj -o "/home/member/$1"
}

same_structures()
{
    [ -n "$(find "/home/member/$1" -name '*.as')" ] || return 1
    for file in "/home/member/$1"/*.as; do
        cmp "$file" "/home/member/$2/${file##*/}" || return 1
    done
}

# counter NAME - prints one of the daemon's counters.
counter()
{
    as member bvhctl --socket "$socket" stats | sed -n "s/^$1  *\([0-9]*\)\$/\1/p"
}

daemon_user()
{
    stat -c %U "/proc/$daemon"
}

# A hundred by a hundred squares of two triangles each.
make_scene()
{
    awk 'BEGIN {
        for (y = 0; y <= 100; y++)
            for (x = 0; x <= 100; x++)
                print "v", x, y, (x * 7 + y * 13) % 5
        for (y = 0; y < 100; y++)
            for (x = 1; x <= 100; x++) {
                at = y * 101 + x
                print "f", at, at + 1, at + 101
                print "f", at + 1, at + 102, at + 101
            }
    }'
}

# What the packages need, two users with a scene, and a list of the files.
prepare()
{
    others=$(apt-get install -s --no-install-recommends "$packages"/*.deb | sed -n 's/^Inst \([^ ]*\) .*/\1/p' |
        grep -v bvh)
    recommended=$(dpkg-deb -f "$packages"/bvhd_*.deb Recommends | tr -d ' ' | tr '|' '\n' | while read -r name; do
        apt-cache show "$name" >/dev/null 2>&1 && echo "$name" && break
    done)
    # shellcheck disable=SC2086 # a list of words
    apt install gcc libc6-dev pkg-config systemd $recommended $others >prepare.log 2>&1 || { tail prepare.log; exit 1; }
    useradd -m member
    useradd -m stranger
    make_scene >/home/member/scene.obj
    record_requests
    ldconfig
    files >before
}

test_install()
{
    expect_quietly 'the packages are installed' apt install "$packages"/*.deb
    expect 'the user' getent passwd bvhd >/dev/null
    expect 'the group' getent group bvhd >/dev/null
    expect 'the socket starts with the system' [ -L /etc/systemd/system/sockets.target.wants/bvhd.socket ]
    expect 'the service does not' [ -z "$(find /etc/systemd -name 'bvhd.service')" ]
    expect 'users enable theirs' [ -z "$(find /etc/systemd/user -name 'bvhd*')" ]
    expect "the socket is started: $(cat "$requests")" asked 'bvhd.socket start'
    expect 'the service is not' not grep -q 'bvhd[.]service' "$requests"
    expect "the socket's folder" [ -d "${socket%/*}" ]
    expect "the files are those of the packages: $(dpkg --verify)" [ -z "$(dpkg --verify)" ]
    libdir=/usr/lib/$(gcc -print-multiarch)
    for path in "$libdir/libbvhd.so.0" "$libdir/libbvhd_build.so.0" "$libdir/libbvhd.a" "$libdir/pkgconfig/bvhd.pc" \
        /usr/lib/python3/dist-packages/bvhd/client.py /usr/share/man/man1/bvhctl.1.gz /usr/share/man/man8/bvhd.8.gz \
        /usr/share/man/man5/bvhd.conf.5.gz /usr/share/man/man3/bvhd_batch_submit.3.gz \
        /usr/share/bash-completion/completions/bvhctl /usr/share/zsh/vendor-completions/_bvhd \
        /usr/share/doc/bvhd/examples/trace_cpu.c; do
        expect "installed: $path" [ -e "$path" ]
    done
}

test_service()
{
    usermod -aG bvhd member
    listen
    expect_quietly 'a stranger does not get in' not as stranger bvhctl --socket "$socket" ping
    expect_quietly 'the service builds' served first
    expect "the daemon is the service's user" [ "$(daemon_user)" = bvhd ]
    built=$(counter builds_done)
    expect "the daemon has built: $built" [ "$built" -ge 1 ]
    expect_quietly 'the tool builds by itself' as member bvhctl --local build /home/member/scene.obj -o /home/member/own
    expect_quietly 'the same bytes' same_structures first own
}

# Embree is where the builders look for it. Packages of amd64 are built with it.
test_embree()
{
    [ "$(dpkg --print-architecture)" = amd64 ] || return 0
    expect_quietly 'the tool builds by Embree' \
        as member bvhctl --local build /home/member/scene.obj -o /home/member/embree --builder embree
    expect_quietly 'so does the service' as member bvhctl --socket "$socket" build /home/member/scene.obj \
        -o /home/member/served --builder embree
    expect_quietly 'the same bytes by Embree' same_structures embree served
}

test_library()
{
    # shellcheck disable=SC2046 # flags are lists of words
    expect_quietly 'an example is compiled' gcc -o trace_cpu /usr/share/doc/bvhd/examples/trace_cpu.c \
        $(pkg-config --cflags --libs bvhd)
    expect_quietly 'it traces' ./trace_cpu /home/member/first/*.as
    cat >build.py <<'END'
import sys
import bvhd, numpy
corners = numpy.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=numpy.float32)
indices = numpy.array([[0, 1, 2]], dtype=numpy.uint32)
client = bvhd.Client(sys.argv[1])
assert client.build(bvhd.Triangles(corners, indices)).size > 0
END
    cp build.py /home/member/
    expect_quietly 'Python builds by the service' as member python3 /home/member/build.py "$socket"
}

# Prints the names of the packages.
names()
{
    for package in "$packages"/*.deb; do
        dpkg-deb -f "$package" Package
    done
}

# Prints the packages' files in /etc, which belong to the administrator.
configured()
{
    # shellcheck disable=SC2046,SC2016 # a list of words; dpkg fills this in
    dpkg-query -W -f '${Conffiles}\n' $(names) | sed -n 's/^ \([^ ]*\) .*/\1/p'
}

# Checks that the administrator's change is in each of these files.
changed()
{
    for file in $configuration; do
        grep -q '^# a change of the administrator' "$file" || return 1
    done
}

# The daemon that runs goes on until it is restarted, which the package asks for. The next one has what was built.
test_upgrade()
{
    running=$daemon
    configuration=$(configured)
    for file in $configuration; do
        echo '# a change of the administrator' >>"$file"
    done
    from_now
    expect_quietly 'the upgrade' apt install "$newer"/*.deb
    expect 'a higher version' [ "$(dpkg-query -W -f '${Version}' bvhd)" = "$(dpkg-deb -f "$newer"/bvhd_*.deb Version)" ]
    expect "the service is restarted if it runs: $(cat "$requests")" asked 'bvhd.service try-restart'
    expect 'the socket is not stopped' not grep -Eq 'bvhd[.]socket (stop|restart|try-restart)' "$requests"
    expect 'the service has its configuration' [ "$configuration" = /etc/bvhd/bvhd.conf ]
    expect "the configuration stays: $configuration" changed
    expect_quietly 'the daemon serves' served again
    expect 'it is the same one' [ "$(readlink "/proc/$running/exe")" = '/usr/bin/bvhd (deleted)' ]
    expect_quietly 'the daemon ends in order' stop
    listen
    expect_quietly 'the new one serves' served later
    expect 'it runs the new file' [ "$(readlink "/proc/$daemon/exe")" = /usr/bin/bvhd ]
    expect "the cache on disk has all of it: $(counter hits_disk) of $built" [ "$(counter hits_disk)" = "$built" ]
    expect 'nothing is built' [ "$(counter builds_done)" = 0 ]
    expect_quietly 'the same bytes again' same_structures first again
    expect_quietly 'and from the disk' same_structures first later
}

test_removal()
{
    from_now
    # shellcheck disable=SC2046 # a list of words
    expect_quietly 'removal' apt remove $(names)
    expect "the socket is stopped: $(cat "$requests")" asked 'bvhd.socket stop'
    expect_quietly 'the daemon ends in order again' stop
    expect "the configuration is kept: $configuration" changed
    # shellcheck disable=SC2046
    expect_quietly 'purge' dpkg --purge $(names)
    files >after
    expect "nothing is left: $(diff before after | grep '^[<>]')" cmp -s before after
    expect 'but the user, as policy says' getent passwd bvhd >/dev/null
}

prepare
test_install
test_service
test_embree
test_library
test_upgrade
test_removal
echo "$checks expectations, $failures do not hold"
[ $failures -eq 0 ]
