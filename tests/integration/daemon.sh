#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# daemon.sh BVHD DAEMON_HELPER - tests how the daemon is started and stopped: options, the socket's file, signals, idle
# exit, socket activation, notifications. It prints each expectation that does not hold, and its status is 1 if there is
# one.
set -u
# shellcheck source=tests/support/expect.sh
. "$(dirname "$0")/../support/expect.sh"
bvhd=$(realpath "$1")
helper=$(realpath "$2")
scratch=$(mktemp -d)
started=
cleanup()
{
    for pid in $started; do
        kill -9 "$pid" 2>/dev/null
    done
    rm -rf "$scratch"
}
trap cleanup EXIT
trap 'exit 1' HUP INT TERM
cd "$scratch" || exit 1
unset NOTIFY_SOCKET WATCHDOG_USEC WATCHDOG_PID LISTEN_FDS LISTEN_PID LISTEN_FDNAMES XDG_RUNTIME_DIR JOURNAL_STREAM
# eventually WHAT COMMAND... - expects that the command succeeds within 20 seconds.
eventually()
{
    what=$1
    shift
    checks=$((checks + 1))
    for _ in $(seq 400); do
        quietly "$@" && return
        sleep 0.05
    done
    echo "does not hold: $what"
    failures=$((failures + 1))
}

quietly()
{
    "$@" >/dev/null 2>&1
}

# refused CODE ARGUMENT... - expects that bvhd ends with that code and one line; its output is in `out` and `err`.
refused()
{
    code=$1
    shift
    timeout 20 "$bvhd" "$@" >out 2>err
    got=$?
    expect "status $code of: bvhd $* (got $got)" [ $got -eq "$code" ]
    expect "one line on stderr: $(head -c 300 err)" [ "$(wc -l <err)" -eq 1 ]
    expect "it reads bvhd: WHERE: WHAT: $(head -c 300 err)" grep -Eq '^bvhd: [^:]+(:[0-9]+)?: .+' err
}

# start ARGUMENT... - starts a daemon on the socket `s` and waits until it answers. $daemon is its process, `log` has
# its messages. The output of clients of the daemon before is removed.
start()
{
    rm -f held built
    "$bvhd" --socket s --no-cache "$@" 2>log &
    daemon=$!
    started="$started $daemon"
    eventually "it answers: bvhd $*" "$helper" ping s
}

# ended CODE WHAT - expects that the daemon ends with that status within a minute.
ended()
{
    for _ in $(seq 1200); do
        grep -q '^State:[^Z]*$' "/proc/$daemon/status" 2>/dev/null || break
        sleep 0.05
    done
    kill -9 "$daemon" 2>/dev/null
    wait "$daemon" 2>/dev/null
    got=$?
    expect "status $1 after $2 (got $got: $(tail -n 3 log))" [ $got -eq "$1" ]
}

gone()
{
    ! [ -e "$1" ]
}

has()
{
    grep -q -- "$@"
}

# Wrong usage, help and version.
refused 2 --fly
refused 2 word
refused 2 --workers
refused 2 --workers 0
refused 2 --memory lots
timeout 20 "$bvhd" --help >out 2>err
expect 'help is no failure' [ $? -eq 0 ]
for name in socket workers cache cache-size memory config help version log-level idle-exit drain-timeout \
    max-connections slow-build metrics disk-cache-size no-cache; do
    expect "the help names --$name" has "--$name" out
done
timeout 20 "$bvhd" --version >out 2>err
expect 'the version is no failure' [ $? -eq 0 ]
expect 'a version' grep -Eq '^bvhd [0-9]+\.[0-9]+\.[0-9]+$' out
for word in --help --version; do
    "$bvhd" $word >/dev/full 2>/dev/null
    expect "a full disk is a failure of $word" [ $? -eq 1 ]
done

# A directory for results: they outlive the daemon. One that cannot be used is named, and the daemon works without it.
start --cache d
expect 'a build' quietly "$helper" build s 100
kill -TERM "$daemon"
ended 0 'a directory for results'
start --cache d --disk-cache-size 2M
eventually 'the result is found again' has "event=disk_cache dir=\"$scratch/d\" entries=1 " log
kill -TERM "$daemon"
ended 0 'a directory with results'
echo precious >f
start --cache f
expect 'the directory is named' has 'level=warning event=no_disk_cache dir="f" .*no directory' log
expect 'it is no error' [ "$(grep -c level=error log)" -eq 0 ]
expect 'it builds' quietly "$helper" build s 100
expect 'what is no directory stays' has precious f
kill -TERM "$daemon"
ended 0 'no directory for results'
# WELCOME names the builders that there are. Where Embree's library cannot be loaded, here because a file of its name is
# found that is none, requests that name it are refused by name.
embree=$(grep -ao 'libembree[0-9]*[.]so[.][0-9]*' "$bvhd" | head -n 1)
if [ -n "$embree" ] && [ -n "$(ldconfig -p | grep -F "$embree ")" ]; then
    start
    expect 'both builders are asked' "$helper" builders s >out
    expect "WELCOME names both: $(cat out)" has 'builders 3' out
    expect "Embree builds: $(cat out)" has '^OK *$' out
    kill -TERM "$daemon"
    ended 0 'with Embree'
fi
mkdir -p absent
: >"absent/${embree:-none}"
LD_LIBRARY_PATH=$scratch/absent${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH} start
expect 'Embree is asked for' "$helper" builders s >out
expect "WELCOME names bvhd's own builder alone: $(cat out)" has 'builders 1' out
expect "Embree is refused by name: $(cat out)" has 'UNSUPPORTED .*build.builder' out
expect 'it builds by its own' quietly "$helper" build s 100
kill -TERM "$daemon"
ended 0 'without Embree'
printf 'cache = d\n' >conf
start --config conf
expect 'it builds' quietly "$helper" build s 100
kill -TERM "$daemon"
ended 0 --no-cache
expect 'it keeps nothing' [ "$(grep -c disk_cache log)" -eq 0 ]
refused 2 --disk-cache-size 1000

# Options from a file.
printf 'workers = 1\n# a comment\nnonsense = 3\n' >conf
refused 2 --config conf
expect 'the line is named' has '^bvhd: conf:3: ' err
refused 1 --config missing.conf
printf 'socket = elsewhere\nworkers = 1\nlog-level = debug\n' >conf
start --config conf
expect 'the command line wins' gone elsewhere
expect 'the rest holds' has 'level=debug event=connected' log
kill -TERM "$daemon"
ended 0 'a file of options'

# SIGHUP reads the file again. A wrong file changes nothing, and what needs a new start is said.
printf 'log-level = info\n' >conf
start --no-cache --config conf
printf 'log-level = debug\ndrain-timeout = 0\nworkers = 1\nmax-connections = 2\n' >conf
kill -HUP "$daemon"
eventually 'it has read the file again' has event=reloaded log
quietly "$helper" ping s
eventually 'the new level holds' has 'level=debug event=connected' log
expect 'what needs a new start is named' has 'event=reload_incomplete option=workers' log
echo 'nonsense = 3' >conf
kill -HUP "$daemon"
eventually 'a wrong file is refused by its line' has 'event=reload_failed where="conf:1"' log
expect 'it still answers' quietly "$helper" ping s
rm conf
mkfifo conf
kill -HUP "$daemon"
eventually 'a pipe stops nobody' has 'event=reload_failed where="conf" why="not a regular file"' log
expect 'it answers all the same' quietly "$helper" ping s
kill -TERM "$daemon"
ended 0 'a file that is read again'
refused 1 --socket s --config conf
rm conf

# A user's own file is read if it is there, and may come later.
XDG_CONFIG_HOME=$scratch/config
export XDG_CONFIG_HOME
start --no-cache --user-config
mkdir -p config/bvhd
printf 'log-level = debug\n' >config/bvhd/bvhd.conf
kill -HUP "$daemon"
eventually 'the file that has come is read' has 'event=reloaded file=".*/config/bvhd/bvhd.conf"' log
quietly "$helper" ping s
eventually 'it holds' has 'level=debug event=connected' log
kill -TERM "$daemon"
ended 0 'the file of a user'
rm -r config

# The file of the socket.
start
expect 'its mode is 0600' [ "$(stat -c %a s)" = 600 ]
refused 1 --socket s
expect 'the address is in use' has 'address in use' err
expect 'the first one still answers' quietly "$helper" ping s
kill -TERM "$daemon"
ended 0 SIGTERM
expect 'the socket is removed' gone s
expect 'it says where it listened' has 'event=listening socket="s"' log
expect 'and that it leaves' has event=leaving log
start
kill -INT "$daemon"
ended 0 SIGINT
echo precious >s
refused 1 --socket s
expect 'what is no socket stays' has precious s
rm s
refused 1 --socket no/such/place
if [ ! -e /run/bvhd ]; then
    refused 1
    expect "the default can be changed: $(cat err)" has '/run/bvhd/bvhd.sock.listen.lock: .*--socket PATH' err
fi
refused 1 --socket "$(printf '%0200d' 0)"
expect 'the limit is named' has 107 err

# The daemon before was killed and left its socket. It had no standard streams, and none of its sockets became one of
# them.
"$bvhd" --socket s --no-cache <&- >&- 2>&- &
daemon=$!
started="$started $daemon"
eventually 'it answers without standard streams' "$helper" ping s
kill -KILL "$daemon"
wait "$daemon" 2>/dev/null
expect 'the socket of a killed one is left' [ -S s ]
start
kill -TERM "$daemon"
ended 0 'a stale socket'

# With few descriptors it starts and answers; with fewer it says so instead of listening.
# shellcheck disable=SC3045 # every sh that matters has it
if (ulimit -n 512 && "$bvhd" --version) >/dev/null 2>&1; then
    # shellcheck disable=SC3045
    (ulimit -n 512 && exec "$bvhd" --socket s --no-cache) 2>log &
    daemon=$!
    started="$started $daemon"
    eventually 'it answers with 512 descriptors' "$helper" ping s
    kill -TERM "$daemon"
    ended 0 '512 descriptors'
    # shellcheck disable=SC3045
    (ulimit -n 64 && exec timeout 20 "$bvhd" --socket s --no-cache) >out 2>err
    expect 'with 64 descriptors it does not start' [ $? -eq 1 ]
    expect 'it says what is missing' grep -q '^bvhd: file descriptors: .* can be opened, and at least .*ulimit' err
    expect 'it leaves no socket' gone s
fi

# The daemon tells about itself: by a line for each slow structure, and by the socket for monitoring.
start --slow-build 0.001 --metrics m
"$helper" build s 100000 >built
expect 'it was built' has 'result OK' built
who='connection=[0-9]+ uid=[0-9]+ pid=[0-9]+ request=[0-9]+'
expect "a slow structure: $(cat log)" grep -Eq "event=slow_build $who item=0 .* primitives=100000 .*why=.it" log
expect 'the mode of the other socket' [ "$(stat -c %a m)" = 600 ]
if command -v curl >/dev/null; then
    curl --silent --unix-socket m http://bvhd/metrics >metrics
    expect "what was built: $(head -n 5 metrics)" has '^bvhd_builds_done_total 1$' metrics
    expect 'latencies' has '^bvhd_latency_seconds_count{stage="total"} 1$' metrics
    curl --silent --head --unix-socket m http://bvhd/metrics >metrics
    expect 'only GET' has '^HTTP/1.0 405 ' metrics
else
    echo "the metrics were not read: there is no curl"
fi
kill -TERM "$daemon"
ended 0 'monitoring'
expect 'both sockets are gone' gone m
refused 1 --socket s --metrics no/such/place
refused 2 --metrics ''

# There are more connections than it may have.
start --max-connections 1 --log-level debug
eventually 'the clients that waited for its answer have gone' \
    sh -c '[ "$(grep -c event=connected log)" -eq "$(grep -c event=disconnected log)" ]'
"$helper" hold s >held &
eventually 'one is in' has welcome held
"$helper" ping s >out 2>err
expect 'another one is not' [ $? -ne 0 ]
expect 'it says so' has event=connection_refused log
kill -TERM "$daemon"
ended 0 'a full house'

# Draining: clients get a message, running builds are finished, and new clients are refused.
start
"$helper" hold s >held &
"$helper" build s 400000 >built &
eventually 'one waits' has welcome held
eventually 'one has asked for a build' has sent built
kill -TERM "$daemon"
eventually 'nobody new is let in' gone s
ended 0 'a drain'
eventually 'it was told' has goodbye held
eventually 'then the connection ended' has closed held
eventually 'the build was finished, or refused: nothing is lost' grep -Eq '^(result OK|error)' built
start
"$helper" build s 400000 >built &
eventually 'the build has begun' has prepared built
kill -TERM "$daemon"
ended 0 'a drain with work'
eventually 'what had begun was finished' has 'result OK' built

# A drain without patience, and a drain that a second signal ends.
for patience in 0 100; do
    start --workers 1 --drain-timeout $patience
    "$helper" build s 1500000 >built &
    eventually 'a long build has begun' has prepared built
    kill -TERM "$daemon"
    [ $patience = 0 ] || { eventually 'it drains' has event=draining log && kill -TERM "$daemon" 2>/dev/null; }
    ended 0 "a build that was not waited for ($patience)"
    eventually 'its client is told by the end of the connection' grep -Eq '^(closed|result|error)' built
done

# Idle exit.
start --idle-exit 1
ended 0 idleness
expect 'it says so' has event=idle log
expect 'the socket is removed' gone s
start --idle-exit 1.5
"$helper" hold s >held &
client=$!
eventually 'one is in' has welcome held
sleep 2.5
expect 'it stays for a client' kill -0 "$daemon"
kill "$client"
ended 0 'the last client'

# A signal arrives when the daemon becomes idle. Its messages are not read, so the time for idle exit passes while it
# begins to drain.
mkfifo full
exec 9<>full
"$bvhd" --socket s --no-cache --idle-exit 2 2>&9 &
daemon=$!
started="$started $daemon"
eventually 'it answers, its words unread' "$helper" ping s
timeout 0.5 cat /dev/zero >&9
kill -TERM "$daemon"
sleep 2.5
timeout 1 cat <&9 | tr -d '\0' >log
ended 0 'a signal and idleness at once'
exec 9<&-
expect 'the signal ended it' has event=draining log

# Notifications: ready when it answers, alive at intervals, stopping.
"$helper" notify n 20 >told &
listener=$!
started="$started $listener"
eventually 'there is a socket for notifications' [ -S n ]
NOTIFY_SOCKET=$scratch/n WATCHDOG_USEC=200000 "$bvhd" --socket s --no-cache 2>log &
daemon=$!
started="$started $daemon"
eventually 'it is ready' has '^READY=1 STATUS=listening on s$' told
expect 'then it answers' quietly "$helper" ping s
sleep 1
alive=$(grep -c '^WATCHDOG=1$' told)
expect "it says that it lives, about every 100 ms: $alive times" [ "$alive" -ge 4 ]
kill -STOP "$daemon"
sleep 0.3
before=$(grep -c '^WATCHDOG=1$' told)
sleep 0.6
expect 'it does not when it stands still' [ "$(grep -c '^WATCHDOG=1$' told)" -eq "$before" ]
kill -CONT "$daemon"
rm -f built
"$helper" build s 1500000 >built &
eventually 'it builds' has prepared built
before=$(grep -c '^WATCHDOG=1$' told)
eventually 'it says so while it builds' sh -c "[ \$(grep -c '^WATCHDOG=1\$' told) -gt $((before + 1)) ]"
kill -TERM "$daemon"
ended 0 notifications
eventually 'it said that it stops' has '^STOPPING=1 ' told
kill "$listener"

# Socket activation.
if command -v systemd-socket-activate >/dev/null; then
    systemd-socket-activate -l "$scratch/a" "$bvhd" --no-cache 2>log &
    daemon=$!
    started="$started $daemon"
    eventually 'it answers on the socket handed over' "$helper" ping a
    expect 'and listens nowhere else' gone s
    kill -TERM "$daemon"
    ended 0 'socket activation'
    expect 'the socket stays: it is the manager'"'"'s' [ -S a ]
    rm -f a
    for wrong in "-d -l $scratch/a" "-l $scratch/a -l $scratch/b" "--seqpacket -l $scratch/a"; do
        # shellcheck disable=SC2086 # words
        systemd-socket-activate $wrong "$bvhd" 2>log &
        daemon=$!
        started="$started $daemon"
        eventually 'somebody takes what is sent there' "$helper" poke a
        ended 1 "sockets of another kind: $wrong"
        expect 'it says why' has '^bvhd: socket activation: ' log
        rm -f a b
    done
else
    echo "socket activation was not tried: there is no systemd-socket-activate"
fi

echo "$checks expectations, $failures do not hold"
[ $failures -eq 0 ]
