#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl_cache.sh MAKE_SCENE BVHCTL BVHD - tests the cache on disk by the command line: builds in process that use it,
# the command `cache` with and without a daemon, and the options. It prints each expectation that does not hold, and its
# status is 1 if there is one.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
make_scene=$(realpath "$1")
bvhctl=$(realpath "$2")
bvhd=$(realpath "$3")
scratch=$(mktemp -d -p /dev/shm 2>/dev/null || mktemp -d) # in memory, where nothing waits for a disk
trap 'rm -rf "$scratch"' EXIT
cd "$scratch" || exit 1

# cached_count N - whether the last output of --json has that many structures from the cache.
cached_count()
{
    [ "$(grep -o '"cached":true' out | wc -l)" -eq "$1" ]
}

# holds N - whether the directory `kept` has that many results.
holds()
{
    [ "$(find kept -type f -path '*/??/*' ! -name '.*' | wc -l)" -eq "$1" ]
}

"$make_scene" sphere --size 3000 -o ball.ply >/dev/null
"$make_scene" grid --size 300 -o land.ply >/dev/null

# What one build keeps, the next one takes, with the same bytes.
run 0 --local build ball.ply -o one --cache kept --json
expect 'nothing was there' cached_count 0
expect 'both structures are kept' holds 2
run 0 --local build ball.ply -o two --cache kept --json
expect 'both structures are taken' cached_count 2
expect 'nothing was built' [ "$(grep -o '"build_ms":0,' out | wc -l)" -eq 2 ]
expect_quietly 'the same bytes' diff -r one two
run 0 --local build ball.ply -o two --cache kept
expect "it says so: $(cat out)" grep -q ', cached' out
run 2 --local build ball.ply -o two --cache kept --no-cache
one_error_line
run 0 --local build ball.ply -o two --no-cache --json
expect 'none is taken with --no-cache' cached_count 0

# The directory follows from the environment.
run 0 --local build ball.ply -o two --json
expect 'none is taken with an empty BVHD_CACHE' cached_count 0
BVHD_CACHE=$scratch/kept run 0 --local build ball.ply -o two --json
expect 'BVHD_CACHE names it' cached_count 2
unset BVHD_CACHE
mkdir home
HOME=$scratch/home XDG_CACHE_HOME=$scratch/xdg run 0 --local build ball.ply -o two
expect 'below XDG_CACHE_HOME' [ -d xdg/bvhd -a ! -e home/.cache ]
HOME=$scratch/home XDG_CACHE_HOME=relative run 0 --local build ball.ply -o two
expect 'in the home' [ -d home/.cache/bvhd -a ! -e relative ]
expect 'for its owner alone' [ "$(stat -c %a home/.cache/bvhd)" = 700 ]
HOME=$scratch/nowhere XDG_CACHE_HOME='' run 0 --local build ball.ply -o two
expect 'no home is made' [ ! -e nowhere ]
HOME=$scratch/nowhere XDG_CACHE_HOME='' run 1 --local cache show
one_error_line
says 'names its directory'
export BVHD_CACHE=

# Damage is found, and the result is built again.
for entry in kept/*/??/*; do
    printf X | dd of="$entry" bs=1 seek=500 conv=notrunc 2>dd.log
done
run 0 --local build ball.ply -o two --cache kept --json
expect 'damaged results are not taken' cached_count 0
says '2 damaged results in '
says ' were set aside and built again'
expect_quietly 'the same bytes after damage' diff -r one two
run 0 --local build ball.ply -o two --cache kept --json
expect 'they are there again' cached_count 2
expect 'the damaged files are kept' [ "$(find kept -path '*/damaged/*' -type f | wc -l)" -eq 2 ]

# Errors are not kept.
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' >one.obj
before=$(find kept -type f | wc -l)
run 1 --local build missing.ply -o three --cache kept
expect 'nothing more is kept' [ "$(find kept -type f | wc -l)" -eq "$before" ]

# A directory that cannot be used.
mkdir open && chmod 777 open
run 1 --local build ball.ply -o four --cache open
one_error_line
says 'others may write'
XDG_CACHE_HOME=$scratch/ball.ply
export XDG_CACHE_HOME
unset BVHD_CACHE
run 0 --local build ball.ply -o four
expect 'one that was not named is no error' [ -s four/manifest.json ]
run 0 --local build ball.ply -o four -v
says 'results are not kept on disk: '
unset XDG_CACHE_HOME
export BVHD_CACHE=
run 2 --local build ball.ply -o four --cache ''
one_error_line
run 2 --local build ball.ply -o four --cache kept --disk-cache-size many
one_error_line

# The command.
run 0 --local build land.ply -o land --cache kept
run 0 cache show --cache kept --json
one_json_object
expect "its results: $(cat out)" grep -q "\"directory\":\"kept\",\"entries\":4,\"bytes\":[0-9]*}" out
run 0 cache show --cache kept
expect "for people, too: $(cat out)" grep -q '^kept: 4 results, [0-9.]* MB$' out
run 0 cache trim --cache kept --json
expect "there is room for them: $(cat out)" grep -q '"entries":4,.*"removed_entries":0,"removed_bytes":0}' out
# The results of the ball were used before the others.
find kept -type f -path '*/??/*' ! -newer land/manifest.json -exec touch -d '2 days ago' {} +
run 0 --local build land.ply -o land --cache kept --json
run 0 cache trim --cache kept --disk-cache-size 60K --json
expect "older ones go: $(cat out)" grep -q '"removed_entries":[1-9]' out
run 0 --local build land.ply -o land --cache kept --json
expect 'newer ones stay' cached_count 2
run 0 cache clear --cache kept
expect "all go: $(cat out)" grep -q 'kept: 0 results, 0.0 MB' out
expect 'no folder is left' [ "$(find kept -mindepth 1 | wc -l)" -eq 1 ]
run 0 cache show --cache nothing --json
expect 'a missing one is empty' grep -q '"entries":0,"bytes":0}' out
expect 'it is not made' [ ! -e nothing ]
run 0 cache clear --cache "$scratch"
expect 'a directory that is no cache loses nothing' [ -f ball.ply -a -f one/manifest.json ]
run 1 cache show --cache ball.ply
one_error_line
run 2 cache show --cache kept --socket s
one_error_line
run 4 cache show --socket nobody --connect-timeout 0.1
one_error_line
run 2 cache
one_error_line
run 2 cache empty
one_error_line
says "'empty' is none of: show, trim, clear"

# A daemon is asked for its own directory, and refuses other users by name.
chmod 755 .
"$bvhd" --socket daemon.sock --cache "$scratch/daemon" >log 2>&1 &
daemon=$!
trap 'kill $daemon 2>/dev/null; rm -rf "$scratch"' EXIT
run 0 --socket daemon.sock --connect-timeout 30 build ball.ply -o six
run 0 cache show --socket daemon.sock --json
expect "its directory: $(cat out)" grep -q "\"directory\":\"$scratch/daemon\",\"entries\":" out
expect "its memory: $(cat out)" grep -q '"memory_entries":2,"memory_bytes":[1-9]' out
run 0 cache show --socket daemon.sock
expect "its memory, for people: $(cat out)" grep -q "^in the daemon's memory: 2 results, " out
if [ "$(id -u)" -eq 0 ] && command -v setpriv >/dev/null && chmod 666 daemon.sock 2>/dev/null; then
    for words in 'cache clear' 'cache trim' stop; do
        # shellcheck disable=SC2086 # words
        setpriv --reuid 54321 --regid 54321 --clear-groups "$bvhctl" $words --socket daemon.sock >out 2>err
        expect "another user may not $words" [ $? -eq 1 ]
        one_error_line
    done
    setpriv --reuid 54321 --regid 54321 --clear-groups "$bvhctl" cache show --socket daemon.sock >out 2>err
    expect "another user may look: $(cat err)" [ $? -eq 0 ]
    expect 'the daemon runs still' kill -0 "$daemon"
else
    echo 'not tested, for lack of root or setpriv: what another user may not do'
fi
run 0 cache clear --socket daemon.sock --json
expect "nothing is left on disk: $(cat out)" grep -q '"entries":0,"bytes":0,' out
tries=100
until "$bvhctl" cache show --socket daemon.sock --json | grep -q '"memory_entries":0' || [ $((tries -= 1)) -eq 0 ]; do
    sleep 0.1
done
expect 'nor, soon, in memory' [ "$tries" -gt 0 ]
run 0 stop --socket daemon.sock
trap 'rm -rf "$scratch"' EXIT

# A cache that is smaller than the results keeps within its size.
for size in 500 700 900 1100 1300 1500 1700 1900 2100 2300; do
    "$make_scene" sphere --size "$size" -o "ball$size.ply" >/dev/null
    run 0 --local build "ball$size.ply" -o five --cache small --disk-cache-size 1M
done
expect 'it stays small' [ "$(du -sk --apparent-size small | cut -f 1)" -le 1400 ]

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
