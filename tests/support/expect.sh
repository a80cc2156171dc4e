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

# expect_of FILE WHAT COMMAND... - checks that the command succeeds; if not, shows the start of the file. No process
# reads the file for the thousands of expectations that hold.
expect_of()
{
    shown=$1
    what=$2
    shift 2
    checks=$((checks + 1))
    "$@" && return
    echo "does not hold: $what: $(head -c 300 "$shown")"
    failures=$((failures + 1))
}

# is_one_line FILE - whether it has exactly one line.
is_one_line()
{
    { read -r _ && ! read -r _; } <"$1"
}

# says_nothing_of TEXT FILE - whether the text is not in the file.
says_nothing_of()
{
    [ ! -s "$2" ] || ! grep -Fq -- "$1" "$2"
}

# run CODE ARGUMENT... - runs bvhctl, and checks that it exits with that status and that validation layers, where they
# are loaded, report nothing. Its output is in `out` and `err`.
run()
{
    code=$1
    shift
    "$bvhctl" "$@" >out 2>err
    got=$?
    expect_of err "status $code of: bvhctl $* (got $got)" [ $got -eq "$code" ]
    expect_of err 'no message of validation layers' says_nothing_of validation: err
}

one_error_line()
{
    expect_of err 'one line on stderr' is_one_line err
    expect_of err 'it reads bvhctl: WHAT: WHERE: ...' grep -Eq '^bvhctl: [^:]+: .+: .+' err
}

one_json_object()
{
    expect_of out 'one line of JSON' is_one_line out
    expect 'schema 1' grep -q '^{"schema":1,.*}$' out
}

# says TEXT - checks that the last run printed TEXT to stderr.
says()
{
    expect_of err "it says '$1'" grep -Fq -- "$1" err
}

sums()
{
    (cd "$1" && sha256sum -- * | sort -k 2)
}

same_sums()
{
    [ "$(sums "$1")" = "$(sums "$2")" ]
}
