#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# units.sh BUILD - installs the units below a scratch folder and tests that systemd's tools report no mistake and little
# exposure. It starts nothing. It prints each expectation that does not hold. Its status is 1 if there is one, and 77
# (skipped) without systemd's tools.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
export LC_ALL=C
build=$(realpath "$1")
for tool in systemd-analyze systemd-sysusers systemd-tmpfiles; do
    command -v $tool >/dev/null || { echo "there is no $tool"; exit 77; }
done
# shellcheck source=tests/support/scratch.sh
. "$(dirname "$0")/../support/scratch.sh"

# silent COMMAND... - succeeds if the command succeeds and prints nothing.
silent()
{
    "$@" >said 2>&1
    status=$?
    cat said
    [ $status -eq 0 ] && [ ! -s said ]
}

fails()
{
    ! "$@"
}

verify()
{
    silent systemd-analyze verify --man=no --root="$root" bvhd.socket bvhd.service
}

verify_user()
{
    XDG_RUNTIME_DIR=$scratch/run SYSTEMD_UNIT_PATH=$scratch/units:/usr/lib/systemd/user \
        silent systemd-analyze verify --user --man=no units/bvhd.socket units/bvhd.service
}

exposure()
{
    systemd-analyze security --no-pager --offline=yes --threshold="$1" --root="$root" bvhd.service
}

# The scratch system needs the machine's units that ours refer to, basic.target and its dependencies, and the shell that
# reloads.
root=$scratch/root
expect_quietly 'meson install' meson install -C "$build" --no-rebuild --destdir "$root"
units=$(dirname "$(find "$root" -path '*/systemd/system/bvhd.socket')")
prefix=${units%/lib/systemd/system}
for path in bin/bvhd lib/systemd/system/bvhd.service lib/systemd/system/bvhd.socket lib/systemd/user/bvhd.service \
    lib/systemd/user/bvhd.socket lib/sysusers.d/bvhd.conf lib/tmpfiles.d/bvhd.conf; do
    expect_quietly "installed: $path" [ -f "$prefix/$path" ]
done
mkdir -p "$root/usr/lib/systemd" "$root/etc" "$root/run"
[ -e "$root/lib" ] || ln -s usr/lib "$root/lib"
[ -e "$root/bin" ] || mkdir "$root/bin"
cp /bin/sh "$root/bin/"
cp -rn /usr/lib/systemd/system "$root/usr/lib/systemd/"
# systemd reads units in these places only, so the test copies an installation with another prefix there.
case $prefix in
"$root/usr" | "$root/usr/local") ;;
*) cp "$units"/bvhd.* "$root/usr/lib/systemd/system/" ;;
esac

expect_quietly 'systemd finds nothing to say about the units' verify
expect_quietly 'the exposure is at most 0.5' exposure 5
expect_quietly 'there is some' fails exposure 0
mv "$prefix/bin/bvhd" aside
expect_quietly 'a missing program would be found' fails verify
mv aside "$prefix/bin/bvhd"
service=$(find "$root" -path '*/systemd/system/bvhd.service' | tail -n 1)
cp "$service" aside
sed -i 's/^RestartSec=/RestartSecond=/' "$service"
expect_quietly 'a wrong word would be found' fails verify
grep -v -e '^SystemCall' -e '^Private' aside >"$service"
expect_quietly 'a lack of protection would be found' fails exposure 5
cp aside "$service"
expect_quietly 'peers are not hidden' fails grep -q '^PrivateUsers' "$service"

# A user's manager has no option for another root, so its units get the program's path in the scratch folder.
mkdir -m 700 units run
cp "$prefix"/lib/systemd/user/bvhd.* units/
sed -i "s|^ExecStart=/|ExecStart=$root/|" units/bvhd.service
expect_quietly 'nor about those of a user' verify_user
sed -i 's/^RestartSec=/RestartSecond=/' units/bvhd.service
expect_quietly 'a wrong word would be found there, too' fails verify_user
expect_quietly 'the user and the group' systemd-sysusers --root="$root" "$prefix/lib/sysusers.d/bvhd.conf"
expect_quietly 'they are there' grep -q '^bvhd:' "$root/etc/group"
expect_quietly 'the directory' systemd-tmpfiles --root="$root" --create "$prefix/lib/tmpfiles.d/bvhd.conf"
expect_quietly 'it is there' [ -d "$root/run/bvhd" ]

echo "$checks expectations, $failures do not hold"
[ $failures -eq 0 ]
