# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=sh
# setup_vulkan.sh - installs a Vulkan driver with ray queries for ./demo and ./check. setup.sh sources it.
#
# Mesa's lavapipe runs on any processor, and has ray queries and ray-tracing pipelines since Mesa 24.2. Debian 13 has
# it. For Debian 12 it comes from backports, through an apt source that is derived from the machine's own sources, so
# that it is found wherever the machine gets its packages.

setup_driver_package=mesa-vulkan-drivers
setup_driver_version=24.2

# derive_list CODENAME WHICH FILE... - reads one-line sources and prints the line of the backports that belong to
# Debian's main component of that release, or nothing. With WHICH "debian" it takes only addresses that look like
# Debian's, with "any" all.
derive_list()
{
    codename=$1
    which=$2
    shift 2
    # shellcheck disable=SC2016 # awk's dollars
    awk -v codename="$codename" -v which="$which" '
        { sub(/(^|[ \t])#.*/, "") }
        $1 == "deb" {
            at = 2
            options = ""
            if ($2 ~ /^\[/) {
                options = $2
                while (options !~ /\]$/ && at < NF)
                    options = options " " $(++at)
                options = options " "
                at++
            }
            address = $at
            suite = $(at + 1)
            has_main = 0
            for (i = at + 2; i <= NF; i++)
                has_main = has_main || $i == "main"
            if (!has_main || (suite != codename && suite != "stable" && suite != "oldstable") || address ~ /^cdrom:/)
                next
            if (which == "debian" && address !~ /(^|[\/.:])debian([\/.]|$)/)
                next
            print "deb " options address " " suite "-backports main"
            exit
        }' "$@"
}

# derive_stanza CODENAME WHICH FILE... - does the same with deb822 sources. It keeps fields that do not say what is
# fetched (keys, checks, architectures).
derive_stanza()
{
    codename=$1
    which=$2
    shift 2
    # shellcheck disable=SC2016 # awk's dollars
    awk -v codename="$codename" -v which="$which" '
        function has(list, word,    words, count, i) {
            count = split(list, words)
            for (i = 1; i <= count; i++)
                if (words[i] == word)
                    return 1
            return 0
        }
        function good(    words, count, i, kept) {
            count = split(value["uris"], words)
            for (i = 1; i <= count; i++)
                if (words[i] !~ /^cdrom:/ && (which == "any" || words[i] ~ /(^|[\/.:])debian([\/.]|$)/))
                    kept = kept " " words[i]
            return kept
        }
        function finish(    suite) {
            suite = ""
            if (has(value["suites"], "oldstable"))
                suite = "oldstable"
            if (has(value["suites"], "stable"))
                suite = "stable"
            if (has(value["suites"], codename))
                suite = codename
            if (!is_done && suite != "" && has(value["types"], "deb") && has(value["components"], "main") &&
                tolower(value["enabled"]) !~ /no|false|0/ && good() != "") {
                print "Types: deb\nURIs:" good() "\nSuites: " suite "-backports\nComponents: main" others
                is_done = 1
            }
            split("", value)
            others = field = ""
        }
        FNR == 1 { finish() }
        /^#/ { next }
        /^[ \t]*$/ { finish(); next }
        /^[ \t]/ {
            if (field ~ /^(types|uris|suites|components|enabled)$/)
                value[field] = value[field] " " $0
            else
                others = others "\n" $0
            next
        }
        {
            field = tolower(substr($0, 1, index($0, ":") - 1))
            value[field] = substr($0, index($0, ":") + 1)
            if (field !~ /^(types|uris|suites|components|enabled)$/)
                others = others "\n" $0
        }
        END { finish() }' "$@"
}

# setup_backports_source ROOT CODENAME - derives a source of backports from ROOT/etc/apt and writes it there. Prints
# the name of the file that it wrote. The status is 1 when there is nothing to derive from.
setup_backports_source()
{
    folder=$1/etc/apt
    release=$2
    for look in debian any; do
        set --
        for file in "$folder/sources.list" "$folder"/sources.list.d/*.list; do
            [ ! -f "$file" ] || set -- "$@" "$file"
        done
        text=
        kind=list
        [ $# -eq 0 ] || text=$(derive_list "$release" "$look" "$@")
        if [ -z "$text" ]; then
            set --
            for file in "$folder"/sources.list.d/*.sources; do
                [ ! -f "$file" ] || set -- "$@" "$file"
            done
            kind=sources
            [ $# -eq 0 ] || text=$(derive_stanza "$release" "$look" "$@")
        fi
        if [ -n "$text" ]; then
            mkdir -p "$folder/sources.list.d"
            printf '%s\n' "$text" >"$folder/sources.list.d/bvhd-backports.$kind" || return 1
            printf '%s\n' "$folder/sources.list.d/bvhd-backports.$kind"
            return 0
        fi
    done
    return 1
}

# driver_is_new VERSION - succeeds when a version, such as 25.0.7-2~bpo12+1, is new enough.
driver_is_new()
{
    [ -n "$1" ] && dpkg --compare-versions "$1" ge "$setup_driver_version"
}

# Prints the installed version, or nothing.
driver_installed()
{
    # shellcheck disable=SC2016 # dpkg fills these in
    dpkg-query -W -f '${db:Status-Status} ${Version}\n' "$setup_driver_package" 2>/dev/null | sed -n 's/^installed //p'
}

# Prints the newest version that apt knows and that is new enough, or nothing.
driver_available()
{
    apt-cache madison "$setup_driver_package" 2>/dev/null | awk '$NF != "Sources" { print $3 }' |
        while read -r version; do
            ! driver_is_new "$version" || echo "$version"
        done | head -n 1
}

# setup_install_driver - installs the driver with apt, from backports where the release itself has none that is new
# enough. The status is 1, with nothing left behind, when that fails.
setup_install_driver()
{
    codename=$(sed -n 's/^VERSION_CODENAME=//p' /etc/os-release)
    written=
    [ -n "$(driver_available)" ] || setup_as_root apt-get update -q || :
    if [ -z "$(driver_available)" ] && [ -n "$codename" ]; then
        # shellcheck disable=SC2016 # the inner shell fills it in
        written=$(setup_as_root sh -c '. tests/support/setup_vulkan.sh; setup_backports_source "" "$1"' \
            sh "$codename") || written=
        [ -z "$written" ] || setup_say "Wrote $written, for a driver with ray queries: $(tr '\n' ' ' <"$written")"
        setup_as_root apt-get update -q || :
    fi
    version=$(driver_available)
    set -- libvulkan1 "$setup_driver_package"
    case $version in
    *~bpo*) set -- -t "$codename-backports" "$@" ;;
    esac
    if [ -n "$version" ] &&
        setup_as_root env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "$@"; then
        return 0
    fi
    [ -z "$written" ] || setup_as_root rm -f "$written"
    return 1
}

# setup_vulkan [BVHCTL] - installs a driver if there is none. BVHCTL, where it is built already, tells whether a
# device has ray queries. It never fails; without a driver, everything that needs one is left out.
setup_vulkan()
{
    if [ $# -gt 0 ] && "$1" devices --json 2>/dev/null | grep -q '"ray_queries":true'; then
        setup_say "Vulkan: there is a device with ray queries."
        return 0
    fi
    if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
        setup_say "Vulkan: this is not Debian, so no driver is installed. Without one, all that needs it is left out."
        return 0
    fi
    if driver_is_new "$(driver_installed)"; then
        setup_say "Vulkan: $setup_driver_package $(driver_installed) is installed."
        return 0
    fi
    setup_say "Vulkan: installing $setup_driver_package $setup_driver_version or newer with apt, for ray queries"
    if setup_install_driver; then
        setup_say "Vulkan: $setup_driver_package $(driver_installed) is now installed."
    else
        setup_say "Vulkan: no such driver could be installed. All that needs one is left out."
    fi
}
