#!/usr/bin/env bash
# find-guest.sh FOLDER: finds a guest kernel with CAN that runs on this processor, and prints `KERNEL MODULES [OPTION]`.
#
# Where there is none, it says why on standard error, and exits with 1 if the processor is the cause, else with 2: a script or a package
# that is broken must not pass for a processor. What it fetches stays in FOLDER.
#
# The kernel of Debian 12 (6.1) aborts on a processor whose register state is larger than it knows, for example one with AMX: "ptrace set fp
# regs failed". So each kernel is booted once, with the very script and modules of the test, before it is chosen: first the one that is
# installed, then the one of Debian's unstable release, which is unpacked into FOLDER beside the system.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
folder=$(mkdir -p "$1" && cd "$1" && pwd)

# Does this kernel start the job of the test, with its CAN buses up, and halt? Leaves what it printed in FOLDER/NAME.boot.
boots() { # NAME KERNEL MODULES OPTION
    local work status
    work=$(mktemp -d)
    echo 'ip -brief link show vcan0 && ip -brief link show vcan1' >"$work/job.sh"
    # In a shell of its own, since the shell says on its standard error that a job was aborted.
    (timeout --kill-after=5 60 "$2" mem=256M quiet ${4:+"$4"} rootfstype=hostfs rootflags=/ ro con=null con0=null,fd:1 \
        init="$here/guest.sh" WORK="$work" MODULES="$3" SECONDS_LEFT=20 </dev/null >"$folder/$1.boot" 2>&1 || true) 2>/dev/null
    cat "$work/log" >>"$folder/$1.boot" 2>/dev/null || true
    status=$(cat "$work/status" 2>/dev/null || echo none)
    rm -rf "$work"
    [[ $status == 0 ]]
}

# One line that says how a kernel failed: its own last word on registers, a panic, or the last thing printed.
reason() { # NAME
    grep -m 1 -E 'ptrace|Kernel panic' "$folder/$1.boot" || tail -n 1 "$folder/$1.boot" | grep . || echo "it printed nothing"
}

# Unpacks the kernel and C library of Debian's unstable release. Nothing outside FOLDER changes.
unpack_newer() {
    local mirror debian root library
    for tool in apt-get dpkg patchelf; do
        command -v "$tool" >/dev/null || { echo "no $tool here"; return 1; }
    done
    [[ -f /usr/share/keyrings/debian-archive-keyring.gpg ]] || { echo "no keys of Debian's archive: apt-get install debian-archive-keyring"; return 1; }
    mirror=$(grep -rhoE 'https?://[^ ]+/debian/?( |$)' /etc/apt 2>/dev/null | grep -v snapshot | sort -u | head -n 1 | tr -d ' ' || true)
    [[ -n $mirror ]] || { echo "the system's package sources name no mirror of Debian"; return 1; }
    debian=$folder/debian root=$folder/debian/root
    rm -rf "$debian" && mkdir -p "$debian/lists/partial" "$debian/cache/archives/partial"
    echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $mirror sid main" >"$debian/sources.list"
    local apt=(timeout 300 apt-get -qq -o "Dir::Etc::sourcelist=$debian/sources.list" -o Dir::Etc::sourceparts=/dev/null
        -o "Dir::State::lists=$debian/lists" -o "Dir::Cache=$debian/cache" -o APT::Sandbox::User=root
        # A mirror that lags behind is new enough; what it serves is signed all the same.
        -o Acquire::Check-Valid-Until=false)
    (
        cd "$debian" && "${apt[@]}" update && "${apt[@]}" download user-mode-linux libc6 \
            && dpkg -x user-mode-linux_*.deb "$root" && dpkg -x libc6_*.deb "$root"
    ) >"$folder/fetch" 2>&1 || { echo "Debian's unstable release could not be fetched: $(tail -n 1 "$folder/fetch")"; return 1; }
    library=$root/usr/lib/x86_64-linux-gnu
    # The kernel starts itself anew, so that naming the loader on the command line does not do.
    cp "$root/usr/bin/linux.uml" "$folder/linux.uml"
    patchelf --set-interpreter "$library/ld-linux-x86-64.so.2" --set-rpath "$library" "$folder/linux.uml" || return 1
    rm -rf "$debian"/{lists,cache} "$debian"/*.deb
}

modules_of() { # ROOT
    local found=("$1"/usr/lib/uml/modules/*/kernel)
    echo "${found[-1]}"
}

installed=$(command -v linux.uml) || { echo "no linux.uml is installed" >&2; exit 2; }
if boots installed "$installed" "$(modules_of "")"; then
    echo "$installed $(modules_of "")"
    exit 0
fi
why="the installed linux.uml does not run here ($(reason installed))"
grep -q 'ptrace set fp regs failed' "$folder/installed.boot" || { echo "$why; the whole output: $folder/installed.boot" >&2; exit 2; }

newer=$folder/linux.uml
[[ -x $newer ]] || said=$(unpack_newer) || { echo "$why; a newer one cannot be had: $said" >&2; exit 1; }
# Without seccomp it follows each system call by ptrace, and is too slow for nodes that tick by their own clock.
if boots newer "$newer" "$(modules_of "$folder/debian/root")" seccomp=on; then
    echo "$newer $(modules_of "$folder/debian/root") seccomp=on"
    exit 0
fi
# Debian's unstable release moves on: the next call fetches it anew.
rm -f "$newer"
echo "$why; neither does the one of Debian's unstable release ($(reason newer))" >&2
exit 1
