# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=sh disable=SC2034,SC2154 # the script that sources this sets $bvhctl and reads $checks
# expect.sh - expectations of the shell tests, which source it. Tests that run bvhctl first set $bvhctl and change to
# their scratch folder.
failures=0
checks=0
# No results on disk, except where a test names a directory of its own.
export BVHD_CACHE=

# expect WHAT COMMAND... - checks that the command succeeds.
expect()
{
    what=$1
    shift
    checks=$((checks + 1))
    "$@" && return
    echo "does not hold: $what"
    failures=$((failures + 1))
}

# expect_quietly WHAT COMMAND... - checks that the command succeeds; if not, shows the start of what it printed.
expect_quietly()
{
    what=$1
    shift
    checks=$((checks + 1))
    "$@" >log 2>&1 && return
    echo "does not hold: $what"
    head -n 20 log
    failures=$((failures + 1))
}

# run CODE ARGUMENT... - runs bvhctl, and checks that it exits with that status and that validation layers, where they
# are loaded, report nothing. Its output is in `out` and `err`.
run()
{
    code=$1
    shift
    "$bvhctl" "$@" >out 2>err
    got=$?
    expect "status $code of: bvhctl $* (got $got: $(head -c 300 err))" [ $got -eq "$code" ]
    expect "no message of validation layers: $(grep validation: err)" [ "$(grep -c validation: err)" -eq 0 ]
}

one_error_line()
{
    expect "one line on stderr: $(cat err)" [ "$(wc -l <err)" -eq 1 ]
    expect "it reads bvhctl: WHAT: WHERE: ...: $(cat err)" grep -Eq '^bvhctl: [^:]+: .+: .+' err
}

one_json_object()
{
    expect "one line of JSON: $(head -c 300 out)" [ "$(wc -l <out)" -eq 1 ]
    expect 'schema 1' grep -q '^{"schema":1,.*}$' out
}

# says TEXT - checks that the last run printed TEXT to stderr.
says()
{
    expect "it says '$1': $(cat err)" grep -Fq -- "$1" err
}

sums()
{
    (cd "$1" && sha256sum -- * | sort -k 2)
}

same_sums()
{
    [ "$(sums "$1")" = "$(sums "$2")" ]
}
