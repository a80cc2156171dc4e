#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# bvhctl_daemon.sh MAKE_SCENE BVHCTL BVHD - tests the command line through a real daemon: the bytes and error messages
# are the same as in process, results are cached, private daemons start in the right place, and a build ends properly
# when its client or its daemon goes away. It prints each expectation that does not hold, and its status is 1 if there
# is one.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
make_scene=$(realpath "$1")
bvhctl=$(realpath "$2")
bvhd=$(realpath "$3")
scratch=$(mktemp -d)
daemons=
cleanup()
{
    for pid in $daemons $(private_daemons); do
        kill -9 "$pid" 2>/dev/null
    done
    rm -rf "$scratch"
}
trap cleanup EXIT
trap 'exit 1' HUP INT TERM
cd "$scratch" || exit 1
mkdir -m 700 run tmp
unset BVHD_SOCKET NOTIFY_SOCKET
export XDG_RUNTIME_DIR="$scratch/run" TMPDIR="$scratch/tmp" XDG_CONFIG_HOME="$scratch/config"
# within SECONDS COMMAND... - repeats the command until it succeeds; fails after that time.
within()
{
    tries=$(($1 * 20))
    shift
    until "$@"; do
        tries=$((tries - 1))
        [ $tries -gt 0 ] || return 1
        sleep 0.05
    done
}

# start SOCKET OPTION... - starts a daemon on that socket and waits until it answers. Sets $daemon to its process.
start()
{
    socket=$1
    shift
    "$bvhd" --socket "$socket" --no-cache "$@" >>daemon.log 2>&1 &
    daemon=$!
    daemons="$daemons $daemon"
    expect "a daemon on $socket: $(cat daemon.log)" \
        sh -c "'$bvhctl' --socket '$socket' --connect-timeout 30 ping >/dev/null"
}

# gone PID - the process has ended; it may be a zombie.
gone()
{
    [ -z "$(tr -d '\0' 2>/dev/null <"/proc/$1/cmdline")" ]
}

# Prints the processes of the daemons that bvhctl started in this test. One search through all processes finds those
# that name the folder.
private_daemons()
{
    for entry in $(grep -asl -F -- "$scratch/" /proc/[0-9]*/cmdline); do
        if tr '\0' ' ' 2>/dev/null <"$entry" | grep -q "bvhd --socket $scratch/"; then
            pid=${entry#/proc/}
            pid=${pid%/cmdline}
            case " $daemons " in
            *" $pid "*) ;;
            *) echo "$pid" ;;
            esac
        fi
    done
}

private_count()
{
    private_daemons | wc -l
}

private_count_is()
{
    [ "$(private_count)" -eq "$1" ]
}

# counter SOCKET NAME - prints one of the daemon's counters.
counter()
{
    "$bvhctl" --socket "$1" stats | awk -v name="$2" '$1 == name { print $2 }'
}

counter_is()
{
    [ "$(counter "$1" "$2")" = "$3" ]
}

# plain_report FILE - prints a JSON report without the fields that differ between runs.
plain_report()
{
    sed -E 's/"(cached|coalesced)":(true|false),//g; s/"(prepare_ms|build_ms|peak_bytes|wall_ms)":[-+.0-9e]+,?//g
        s/"output":"[^"]*",//' "$1"
}

# same_structures A B - the structures of two folders are the same; their manifests may name other options.
same_structures()
{
    [ "$(sums "$1" | grep '\.as$')" = "$(sums "$2" | grep '\.as$')" ]
}

"$make_scene" sphere --size 3000 -o ball.ply >/dev/null
"$make_scene" nan --size 500 -o nan.ply >/dev/null
"$make_scene" degenerate --size 500 -o degenerate.ply >/dev/null
"$make_scene" stadium-like --size 2000 -o stadium.ply >/dev/null
"$make_scene" park --size 1000 -o park.gltf >/dev/null
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' >one.obj
"$make_scene" sphere --size $((${SIZE:-10000} * 4)) -o large.ply >/dev/null
s=$scratch/s.sock

# There is no daemon: bvhctl waits for an explicit socket, and starts nothing on it.
for command in 'build one.obj -o d' stats clients top ping "get $(printf '%064d' 0) -o f.as"; do
    # shellcheck disable=SC2086 # a list of words
    run 4 --socket "$s" --connect-timeout 0.1 $command
    one_error_line
    expect "the socket is named: $(cat err)" grep -q "$s" err
    # shellcheck disable=SC2086
    BVHD_SOCKET=$s run 4 $command --connect-timeout 0.1 --json
    one_json_object
    expect 'the error is UNAVAILABLE' grep -q '"error":{"status":"UNAVAILABLE"' out
done
expect 'no output was written' [ ! -e d ]
expect 'nothing was started' private_count_is 0
(sleep 0.5; exec "$bvhd" --socket "$s" --no-cache >>daemon.log 2>&1) &
daemons="$daemons $!"
daemon=$!
run 0 --socket "$s" --connect-timeout 30 ping
expect "it answers: $(cat out)" grep -Eq "^$s answers in [0-9.]+ ms$" out

# Wrong usage.
for line in 'get' 'get 1234 -o f' "get $(printf '%064d' 0)" 'stats more' 'ping --local' '--local stats' \
    '--connect-timeout x ping' '--connect-timeout -1 ping' 'stats -o f' 'ping --memory 3'; do
    # shellcheck disable=SC2086
    run 2 $line
    one_error_line
done

run 2 ping --socket ''
one_error_line

# The bytes and the report are the same as in process.
for quality in fast balanced high; do
    for scene in ball.ply nan.ply degenerate.ply stadium.ply one.obj park.gltf; do
        local=local/$quality-${scene%.*}
        remote=remote/$quality-${scene%.*}
        run 0 --local build $scene -o "$local" --quality $quality --json
        cp out local.json
        run 0 --socket "$s" build $scene -o "$remote" --quality $quality --json
        one_json_object
        expect "the same files: $quality $scene" same_sums "$local" "$remote"
        plain_report local.json >local.plain
        plain_report out >remote.plain
        expect "the same report: $quality $scene" cmp -s local.plain remote.plain
    done
done
for options in '--layout fast-triangles' '--flags allow-update,low-memory' '--geometry-flags none' \
    '--quality auto --rays 3' '--flags prefer-fast-build'; do
    # shellcheck disable=SC2086
    {
        run 0 --local build ball.ply park.gltf -o "local/$options" $options
        run 0 --socket "$s" build ball.ply park.gltf -o "remote/$options" $options
    }
    expect "the same files: $options" same_sums "local/$options" "remote/$options"
done
# Embree builds the same in process and in the daemon, or is refused by name in both.
for quality in fast balanced high; do
    options="--builder embree --quality $quality"
    # shellcheck disable=SC2086
    if "$bvhctl" --local build ball.ply park.gltf -o "local/$options" $options >out 2>err; then
        run 0 --socket "$s" build ball.ply park.gltf -o "remote/$options" $options --json
        expect "the method is named: $options" grep -q '"method":"embree-' out
        expect "nothing of the own builder is taken: $options" sh -c '! grep -q "\"cached\":true" out'
        expect "the same files: $options" same_sums "local/$options" "remote/$options"
        run 0 check "remote/$options" ball.ply --rays "${RAYS:-500}"
    else
        expect "the builder is named: $(cat err)" grep -q 'build.builder: ' err
        run 1 --socket "$s" build ball.ply -o "remote/$options" $options
        expect "the builder is named: $(cat err)" grep -q 'build.builder: ' err
    fi
done
# Hints that lead to the same quality share its result, also with requests that name the quality.
run 0 --socket "$s" build ball.ply -o remote/few --rays 0.01 --json
expect 'few rays are for fast' grep -q '"quality":"fast"' out
for options in '--rays 0.02' '--quality auto --rays 0.005' '--quality fast --rays 1000'; do
    # shellcheck disable=SC2086
    run 0 --socket "$s" build ball.ply -o remote/shared --json $options
    expect "a shared result: $options" sh -c 'grep -q "\"cached\":true" out && ! grep -q "\"cached\":false" out'
    expect "the same files: $options" same_structures remote/few remote/shared
done
expect 'no temporary files' [ -z "$(find local remote -name '*.??????' ! -name '*.as' ! -name manifest.json)" ]
run 0 check remote/high-park park.gltf --rays "${RAYS:-500}"

# A request breaks a rule of Vulkan; one of two scenes fails.
run 1 --local build ball.ply -o rule --flags prefer-fast-trace,prefer-fast-build
cp err local.err
run 1 --socket "$s" build ball.ply -o rule2 --flags prefer-fast-trace,prefer-fast-build
expect "the same error lines: $(cat err)" cmp -s err local.err
run 1 --socket "$s" build missing.ply one.obj -o part --json
one_json_object
one_error_line
expect 'the other scene is there' [ -f part/one.tlas.as ]

# Equal work is done once.
before=$(counter "$s" builds_started)
touch -d '2001-01-01' remote/balanced-park/*
touch -d '2002-02-02' stamp
run 0 --socket "$s" build park.gltf -o remote/balanced-park --quality balanced --json
expect 'everything is cached' [ "$(grep -o '"cached":true' out | wc -l)" -eq "$(grep -o '"file"' out | wc -l)" ]
expect 'nothing is built' counter_is "$s" builds_started "$before"
expect 'nothing is rewritten' [ -z "$(find remote/balanced-park -type f -newer stamp)" ]
run 0 --socket "$s" build park.gltf -o remote/balanced-park --quality balanced
expect 'the words for it' grep -q ', cached$' out
before=$(counter "$s" builds_started)
for i in 1 2 3 4 5 6 7 8; do
    {
        "$bvhctl" --socket "$s" build large.ply ball.ply -o "at-once-$i" --layout fast-triangles --quality high \
            >"at-once-$i.out" 2>&1
        echo $? >"at-once-$i.code"
    } &
    at_once="${at_once-} $!"
done
# shellcheck disable=SC2086
wait $at_once
run 0 --local build large.ply ball.ply -o at-once --layout fast-triangles --quality high
for i in 1 2 3 4 5 6 7 8; do
    expect "at once, $i: $(cat "at-once-$i.out")" [ "$(cat "at-once-$i.code")" = 0 ]
    expect "the same bytes at once, $i" same_sums at-once "at-once-$i"
done
expect "eight at once: four builds ($before, then $(counter "$s" builds_started))" \
    counter_is "$s" builds_started $((before + 4))

# A deadline passes while the daemon builds.
run 1 --socket "$s" build large.ply -o late --quality high --layout fast-triangles --flags low-memory --deadline 1
says 'deadline: no result within 1 ms, the deadline of the request'

# The command get.
key=$(grep -o '"key": *"[0-9a-f]*"' remote/balanced-park/manifest.json | head -n 1 | grep -o '[0-9a-f]\{64\}')
file=$(grep -o '"file": *"[^"]*"' remote/balanced-park/manifest.json | head -n 1 | sed 's/.*"\([^"]*\)"$/\1/')
run 0 --socket "$s" get "$key" -o got.as
expect 'the same bytes by key' cmp -s got.as "remote/balanced-park/$file"
run 0 --socket "$s" get "$(echo "$key" | tr a-f A-F)" -o got.as --json
one_json_object
for field in key file bytes origin; do
    expect "the field $field" grep -q "\"$field\":" out
done
expect 'the key as it is written everywhere' grep -q "\"key\":\"$key\"" out
run 1 --socket "$s" get "$(printf '%064d' 7)" -o none.as --json
one_error_line
one_json_object
expect 'an unknown key is NOT_FOUND' grep -q '"status":"NOT_FOUND"' out
expect 'no file of it' [ ! -e none.as ]
run 1 --socket "$s" get "$key" -o no/such/place.as
one_error_line

# The commands stats and ping.
run 0 --socket "$s" stats --json
one_json_object
for field in builds_started builds_done hits_memory hits_disk misses coalesced refused cancelled queue_depth \
    live_result_bytes connections; do
    expect "the counter $field" grep -Eq "\"$field\":[0-9]+[,}]" out
done
within 10 counter_is "$s" queue_depth 0
run 0 --socket "$s" stats
for line in "bvhd +[0-9.]+, process $daemon, up 0 d 0:[0-9:]+, [1-9][0-9]* workers?, [1-9]" \
    'hits +[0-9.]+ % of [1-9][0-9]* structures; [1-9][0-9]* from memory, 0 from disk; ' \
    'queue +0 under way, 0 builds running; ' 'memory +[0-9.]+ of [0-9.]+ MB; ' 'refused +[0-9]+ for lack of room, ' \
    '  (waiting|prepare|build|total) +[1-9][0-9]*( +[0-9]+\.[0-9]{3}){4}$'; do
    expect "the summary: $(head -n 14 out)" grep -Eq "^$line" out
done
expect 'all stages' [ "$(grep -Ec '^  (waiting|prepare|disk|build|total) ' out)" -eq 5 ]
expect 'its process' counter_is "$s" pid "$daemon"
expect 'only the connection that asks' within 10 counter_is "$s" connections 1
expect 'nothing under way' within 10 counter_is "$s" queue_depth 0

# The commands clients and top.
run 0 --socket "$s" clients
expect "a heading and the asker: $(cat out)" grep -Eq "^ +[0-9]+  $(id -un | cut -c 1-10) .*libbvhd [0-9.]+$" out
run 0 --socket "$s" clients --all --json
one_json_object
expect "the asker: $(cat out)" grep -q '"total":1,"hidden":0,"clients":\[{"connection":' out

# Another user sees nobody but itself. That takes root, and a folder that others may enter.
chmod 711 "$scratch"
chmod 666 "$s"
as_other="setpriv --reuid=65534 --regid=65534 --clear-groups"
if [ "$(id -u)" = 0 ] && $as_other test -x "$bvhctl" 2>/dev/null; then
    "$bvhctl" --socket "$s" top --interval 60 >/dev/null 2>&1 &
    watcher=$!
    expect 'there is another client' within 20 counter_is "$s" connections 2
    $as_other "$bvhctl" --socket "$s" clients --json >out 2>err
    expect "it sees one: $(cat out err)" grep -Eq '"total":2,"hidden":1,"clients":\[\{[^}]*"uid":65534,[^}]*\}\]' out
    $as_other "$bvhctl" --socket "$s" clients --all >out 2>err
    expect "it may not see all" [ $? -eq 1 ]
    says 'clients: only root and the user whom the daemon runs as (uid 0) may do this, not uid 65534'
    kill "$watcher"
    wait "$watcher" 2>/dev/null
else
    echo "other users were not tried: that needs root, and a build that others may run"
fi
chmod 700 "$scratch"
run 0 --socket "$s" top --count 3 --interval 0.05
expect 'three pages' [ "$(grep -c '^bvhd  ' out)" -eq 3 ]
expect 'two of them have rates' [ "$(grep -c '^rates  ' out)" -eq 2 ]
expect 'no codes for terminals in a file' [ -z "$(tr -dc '\033' <out)" ]
run 0 --socket "$s" top --count 2 --interval 0.05 --json
expect 'an object for each page' [ "$(grep -c '^{"schema":1,"stats":{"version":' out)" -eq 2 ]
run 0 --socket "$s" ping --json
one_json_object
for field in socket ms; do
    expect "the field $field" grep -q "\"$field\":" out
done

# An interrupt ends the build, in bvhctl, which dies of the signal, and in the daemon. The daemon has one worker, so
# that the build takes a while on any machine. The shell lets its children ignore interrupts, unless env changes that.
"$make_scene" sphere --size $((${SIZE:-20000} * 30)) -o huge.ply >/dev/null
start "$scratch/slow.sock" --workers 1
slow=$daemon
s=$scratch/slow.sock
run 0 --socket "$s" build one.obj -o lost --quality high
rm -r lost
for signal in INT TERM; do
    before=$(counter "$s" builds_started)
    env --default-signal=$signal "$bvhctl" --socket "$s" build huge.ply -o interrupted --quality high --json \
        >out 2>err &
    pid=$!
    expect 'the build has begun' within 120 counter_is "$s" builds_started $((before + 1))
    kill -$signal $pid
    wait $pid
    got=$?
    expect "an interrupted build dies of the signal ($got)" [ "$(kill -l $got)" = $signal ]
    one_error_line
    one_json_object
    expect "it says so: $(cat err)" grep -q interrupted err
    expect 'nothing was written' [ -z "$(find interrupted -type f)" ]
    expect 'the daemon forgets it' within 10 counter_is "$s" queue_depth 0
done
expect 'cancellations are counted' [ "$(counter "$s" cancelled)" -ge 2 ]

# The daemon dies during a build: the build fails, and no half-written file is left.
before=$(counter "$s" builds_started)
"$bvhctl" --socket "$s" build one.obj huge.ply -o lost --quality high --json >out 2>err &
pid=$!
expect 'the build has begun' within 120 counter_is "$s" builds_started $((before + 1))
kill -9 "$slow"
wait $pid
got=$?
expect "a lost daemon is status 4 ($got)" [ $got -eq 4 ]
one_error_line
one_json_object
expect 'the error is UNAVAILABLE' grep -q '"error":{"status":"UNAVAILABLE"' out
expect 'no manifest of a part' [ ! -e lost/manifest.json ]
expect 'whole files only' [ -z "$(find lost -type f ! -name 'one.*.as')" ]

# An idle daemon exits.
start idle.sock --idle-exit 1
expect 'it leaves' within 30 gone "$daemon"
expect 'with its socket' [ ! -e idle.sock ]

# Eight processes start one private daemon together. It inherits nothing from them, and later processes find it.
rm -rf at-once-*
at_once=
for i in 1 2 3 4 5 6 7 8; do
    {
        "$bvhctl" build ball.ply -o "at-once-$i" --connect-timeout 60 >"at-once-$i.out" 2>&1 7>inherited
        echo $? >"at-once-$i.code"
    } &
    at_once="$at_once $!"
done
# shellcheck disable=SC2086
wait $at_once
for i in 1 2 3 4 5 6 7 8; do
    expect "a private daemon for $i: $(cat "at-once-$i.out")" [ "$(cat "at-once-$i.code")" = 0 ]
done
expect "one daemon for all ($(private_count))" private_count_is 1
private=$(private_daemons)
expect 'on the user'"'"'s socket' [ -S run/bvhd.sock ]
expect 'that nobody else may use' [ -z "$(find run/bvhd.sock -perm /077)" ]
expect 'in a session of its own' [ "$(sed 's/.*) //' "/proc/$private/stat" | cut -d ' ' -f 4)" = "$private" ]
expect 'without our descriptors' [ -z "$(find "/proc/$private/fd" -lname "*/inherited")" ]
expect 'it will leave by itself' sh -c "tr '\0' ' ' <'/proc/$private/cmdline' | grep -q -- '--idle-exit [1-9]'"
run 0 build ball.ply -o again --json
expect 'it is asked again' [ "$(grep -o '"cached":true' out | wc -l)" -eq 2 ]
run 0 ping --json
expect 'its socket' grep -q "\"socket\":\"$scratch/run/bvhd.sock\"" out
expect 'it was there' grep -q '"private":true,"started":false' out
run 0 ping
expect "whose it is: $(cat out)" grep -q 'bvhd.sock answers in [0-9.]* ms: a private daemon$' out
run 0 stop
expect "it says whom it has ended: $(cat out)" grep -q "run/bvhd.sock: the daemon, process $private, has ended" out
expect 'it is gone' gone "$private"
expect 'with its socket' [ ! -e run/bvhd.sock ]

# Without a daemon the commands that ask one say where none is, and start none. Only build starts one.
for command in stop stats clients top ping "get $(printf '%064d' 0) -o f.as"; do
    # shellcheck disable=SC2086
    run 4 $command
    one_error_line
    says "$scratch/run/bvhd.sock: no "
    expect "nothing was started by $command" private_count_is 0
done
run 4 ping
says '; /run/bvhd/bvhd.sock: '
says "'bvhctl build' starts a private one"
run 4 stop --json
one_json_object
expect 'the error is UNAVAILABLE' grep -q '"status":"UNAVAILABLE"' out
run 0 build ball.ply -o again
expect 'another one is started' private_count_is 1
kill -9 "$(private_daemons)"
expect 'a socket without a daemon' within 30 private_count_is 0
run 4 ping
says 'bvhd.sock: no daemon: nobody listens; '
run 0 build ball.ply -o again
expect 'it is taken over' private_count_is 1
run 0 stop --json
one_json_object
expect 'no daemon is left' private_count_is 0

# Results of private daemons outlive them, in the user's cache or in the directory that is named.
run 0 build ball.ply -o again
words=$(tr '\0' ' ' <"/proc/$(private_daemons)/cmdline")
expect "an empty BVHD_CACHE means none: $words" [ "${words% --no-cache }" != "$words" ]
run 0 stop
for turn in 1 2; do
    run 0 build ball.ply -o again --cache kept --disk-cache-size 5M --json
    expect "from disk in turn $turn" [ "$(grep -o '"cached":true' out | wc -l)" -eq $((2 * turn - 2)) ]
    run 0 stop
    (unset BVHD_CACHE && XDG_CACHE_HOME=$scratch/caches "$bvhctl" build ball.ply -o again --json >out 2>err)
    expect "from the user's in turn $turn" [ "$(grep -o '"cached":true' out | wc -l)" -eq $((2 * turn - 2)) ]
    run 0 stop
done
expect 'in the directory that was named' [ -e kept/CACHEDIR.TAG ]
expect "in the user's" [ -e caches/bvhd/CACHEDIR.TAG ]
run 2 build ball.ply -o again --cache kept --no-cache

# written SOCKET - whether that daemon has written results to disk.
written()
{
    [ "$(counter "$1" disk_written)" -ge 1 ]
}

# The daemon itself says what it keeps, and forgets it: the user's own one, or the one on a socket that is named.
run 0 build ball.ply -o again --cache kept --quality fast
expect 'it writes' within 30 written run/bvhd.sock
(unset BVHD_CACHE && "$bvhctl" cache clear >out 2>err)
expect "by the private daemon: $(cat out err)" grep -q "^$scratch/kept: removed [1-9]" out
run 0 build ball.ply -o again --quality fast --json
expect 'nothing is in its memory any more' [ "$(grep -o '"cached":true' out | wc -l)" -eq 0 ]
run 0 stop
start named.sock --cache kept
run 0 --socket named.sock build ball.ply -o again
run 0 --socket named.sock cache trim --disk-cache-size 0 --json
one_json_object
expect 'all of it' grep -q "\"directory\":\"$scratch/kept\",\"entries\":0,\"bytes\":0" out
run 0 --socket named.sock stop
start named.sock
run 1 --socket named.sock cache show
says 'this daemon keeps nothing on disk'
run 0 --socket named.sock stop
run 4 --socket named.sock --connect-timeout 0 cache clear

# A daemon on a socket that is named can be stopped, too.
start named.sock
run 0 --socket named.sock stop
expect 'it has ended' gone "$daemon"
run 4 --socket named.sock stop
says 'named.sock: no daemon to stop: '
# The private daemon's program is beside bvhctl, else in $PATH; never where only a build folder would have it.
mkdir -p bin a/b daemon
ln -s "$bvhd" bin/bvhd
cp "$bvhctl" a/b/bvhctl
printf '#!/bin/sh\ntouch %s/trap\n' "$scratch" >daemon/bvhd
chmod +x daemon/bvhd
(PATH="relative:$scratch/bin:$PATH" a/b/bvhctl build ball.ply -o again >out 2>err)
expect "found in the path: $(cat err)" private_count_is 1
kill -TERM "$(private_daemons)"
within 30 private_count_is 0
cp daemon/bvhd a/b/bvhd
a/b/bvhctl --connect-timeout 1 build ball.ply -o again >out 2>err
expect "found beside it: $(cat err)" [ -e trap ]
expect 'a program that ends at once is no daemon' \
    grep -q 'bvhd.sock.log: the daemon that was started ended with status 0' err
rm -r a daemon trap

# There is no session directory: bvhctl uses a directory of the user, which nobody else may own, write or link to.
unset XDG_RUNTIME_DIR
own=$scratch/tmp/bvhd-$(id -u)
run 0 build ball.ply -o again
expect 'a directory for the user alone' [ "$(stat -c %a "$own")" = 700 ]
run 0 ping
expect 'the socket is there' grep -q "^$own/bvhd.sock answers" out
kill -TERM "$(private_daemons)"
within 30 [ ! -S "$own/bvhd.sock" ]
chmod 777 "$own"
run 4 ping
says "$own/bvhd.sock: no daemon: its directory is not yours alone"
run 4 build ball.ply -o again
one_error_line
expect "it says why: $(cat err)" grep -q "$own: no daemon, and none is started here" err
mv "$own" elsewhere
chmod 700 elsewhere
ln -s "$scratch/elsewhere" "$own"
run 4 build ball.ply -o again --json
one_json_object
expect 'nothing was started' [ ! -S elsewhere/bvhd.sock ]
rm "$own"

# A private daemon that cannot start says why.
mkdir -m 700 "$scratch/run2"
export XDG_RUNTIME_DIR="$scratch/run2"
mkdir run2/bvhd.sock
run 4 build ball.ply -o again
one_error_line
expect "the reason is given: $(cat err)" grep -q 'bvhd.sock.log: the daemon that was started ended with status 1: ' err

echo "$checks expectations, $failures of them do not hold"
[ $failures -eq 0 ]
