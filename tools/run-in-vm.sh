#!/bin/sh
# run-in-vm.sh: run a command on a real Linux kernel that has SocketCAN, whatever kernel this machine runs.
#
#   run-in-vm.sh [-c none|kvaser|ctucan|both] [-e uml|qemu] [-w DIR]... [-m MB] [-t SECONDS] [-T] [-v] [--] COMMAND [ARG...]
#   run-in-vm.sh --setup uml|kernel|qemu     fetch and prepare only (uml and qemu are also prepared on first use)
#   run-in-vm.sh --ready uml|kernel|qemu     exit status 0 when that is prepared
#
# The command runs as root in the current directory, with the caller's environment, on a copy-on-write view of the
# whole file system: it sees every file of this machine; what it writes is thrown away, except below each -w DIR.
# There are vcan0 and vcan1 (up, CAN FD), candump and cansend (can-utils), the drivers vcan, vxcan and slcan, and netem.
# stdout and stderr are passed on; stdin is empty; the exit status is that of the command (124: -t ran out; 125: the
# machine did not start or died: its kernel log is on stderr). MSBOT_VM and MSBOT_CAN_HW tell the command where it is.
#
#   uml    Debian's user-mode-linux: a kernel as a plain process, without privileges. One CPU at native speed, a system
#          call costs 15 us. Prepared in 5 s (42 MB), adds 1.6 s to a command.
#   kernel a User-Mode Linux built here from Debian's source (3 minutes on 2 cores); then used in place of `uml`. Adds
#          0.4 s, and knows  -T : simulated time. Whenever all processes sleep the clock jumps, so that ten minutes of
#          heartbeats take two seconds. Nothing outside of the machine may be waited for.
#   qemu   Debian's stock kernel under qemu-system-x86_64 without KVM: Python is 17 times slower, but there are emulated
#          controllers with their real drivers:  -c kvaser  two SJA1000 (classic CAN),  -c ctucan  two CTU CAN FD.
#          As can0 and can1 on one bus, down:  ip link set can0 up type can bitrate 500000 [dbitrate 2000000 fd on]
#          With  -c both  the two SJA1000 are can0 and can1, the two CTU CAN FD can2 and can3. The module gpio-sim (GPIO
#          lines in software), which Debian leaves out, is in the cache, in the folder gpio_sim.
#
# Needs Debian 12 on x86-64 (apt-get, dpkg, iproute2, python3, util-linux); kernel: gcc, make, flex, bison, bc, xz-utils;
# qemu: gcc, make, xz-utils, qemu-system-x86. Nothing is installed, root is not needed.
# Cache: $MSBOT_VM_CACHE (default ~/.cache/msbot-vm): uml 120 MB, kernel 150 MB, qemu 600 MB.
set -eu

engine=uml hardware=none travel='' memory=768 patience=600 verbose=0 setup='' ready='' writable=''
CACHE=${MSBOT_VM_CACHE:-${XDG_CACHE_HOME:-${HOME:-/root}/.cache}/msbot-vm}
PATH=$PATH:/usr/sbin:/sbin

die() { echo "run-in-vm: $*" >&2; exit 125; }
say() { [ $verbose = 0 ] || echo "run-in-vm: $*" >&2; }

while [ $# -gt 0 ]; do case $1 in
    -e) engine=$2; shift 2 ;;
    -c) hardware=$2; shift 2 ;;
    -m) memory=$2; shift 2 ;;
    -t) patience=$2; shift 2 ;;
    -w) mkdir -p "$2"; writable="$writable$(cd "$2" && pwd -P)
"; shift 2 ;;
    -T) travel=time-travel; shift ;;
    -v) verbose=1; shift ;;
    --setup) setup=${2:-uml}; break ;;
    --ready) ready=${2:-uml}; break ;;
    --) shift; break ;;
    -*) sed -n '2,/^set/{/^#/s/^# \{0,1\}//p;}' "$0"; exit 2 ;;
    *) break ;;
esac; done
[ $hardware = none ] || engine=qemu

# ---- Preparing: every step is made in a temporary folder and moved into the cache when it is whole ------------------

MODULES='can-dev vcan vxcan slcan can can-raw overlay sch_netem'

fetch() {  # fetch PACKAGE[=VERSION] FOLDER: download and unpack, without installing
    [ -d "$CACHE/$2" ] && return 0
    say "fetching $1"; t=$(mktemp -d "$CACHE/tmp.XXXXXX"); chmod 777 "$t"
    (cd "$t" && apt-get -qq -o Acquire::Retries=3 download "$1" >log 2>&1) ||
        { cat "$t/log" >&2; rm -rf "$t"; die "cannot download the package $1: does \`apt-get update\` work?"; }
    mkdir "$t/x"; chmod 755 "$t/x"; dpkg -x "$t"/*.deb "$t/x"; dpkg -f "$t"/*.deb > "$t/x/control"
    mkdir -p "$(dirname "$CACHE/$2")"; mv "$t/x" "$CACHE/$2"; rm -rf "$t"
}

loading_order() {  # loading_order FOLDER NAME...: the files of these modules and of what they need, in order
    d=$1; shift
    for m; do sed -n "s#^\(.*/\)\{0,1\}$m\.ko:\(.*\)#&#p" "$d/modules.dep"; done |
        awk -v d="$d" '{sub(":","",$1); for(i=NF;i>0;i--) if(!seen[$i]++) print d "/" $i}'
}

unpack_source() {  # unpack_source FOLDER TAR-OPTION...: the kernel's source, as far as wanted
    o=$1; shift
    fetch linux-source-6.1 source
    mkdir -p "$o"; tar xf "$CACHE"/source/usr/src/linux-source-6.1.tar.xz -C "$o" --strip-components=1 "$@"
}

setup_tools() { fetch busybox-static busybox; fetch can-utils can-utils; }

setup_uml() {
    setup_tools
    [ -x "$CACHE/kernel/linux" ] && return 0
    fetch user-mode-linux uml
    [ -e "$CACHE/uml/mods" ] && return 0
    loading_order "$(echo "$CACHE"/uml/usr/lib/uml/modules/*)" $MODULES > "$CACHE/uml/mods.new"
    mv "$CACHE/uml/mods.new" "$CACHE/uml/mods"
}

setup_kernel() {
    setup_tools
    [ -x "$CACHE/kernel/linux" ] && return 0
    s=$(mktemp -d "$CACHE/tmp.XXXXXX"); say "building a kernel (minutes)"
    (exec >"$CACHE/kernel.log" 2>&1
    unpack_source "$s" --exclude='*/drivers/gpu/*.[ch]' --exclude='*/sound/*.[ch]' \
        --exclude='*/Documentation/*.rst' --exclude='*/tools/testing/*'
    cd "$s"
    for i in 64BIT X86_64 HOSTFS SYSVIPC POSIX_MQUEUE HIGH_RES_TIMERS NO_HZ_IDLE TMPFS OVERLAY_FS DEVTMPFS \
        BINFMT_SCRIPT BINFMT_ELF UNIX98_PTYS MAGIC_SYSRQ PROC_FS SYSFS EPOLL EVENTFD SIGNALFD TIMERFD INOTIFY_USER \
        FUTEX SHMEM NAMESPACES NET_NS USER_NS PID_NS IKCONFIG IKCONFIG_PROC NET PACKET UNIX INET IP_MULTICAST IPV6 \
        NETDEVICES NET_SCHED NET_SCH_NETEM CAN CAN_RAW CAN_DEV CAN_NETLINK CAN_CALC_BITTIMING CAN_VCAN CAN_VXCAN \
        CAN_SLCAN UML_TIME_TRAVEL_SUPPORT UML_RANDOM STDERR_CONSOLE SSL NULL_CHAN PORT_CHAN PTY_CHAN TTY_CHAN FD_CHAN
    do echo "CONFIG_$i=y"; done > all.config
    printf '%s\n' 'CONFIG_CON_ZERO_CHAN="fd:0,fd:1"' 'CONFIG_CON_CHAN="null"' 'CONFIG_SSL_CHAN="null"' >> all.config
    make -s ARCH=um KCONFIG_ALLCONFIG=all.config alldefconfig; make -s ARCH=um -j2
    mkdir k; strip -o k/linux linux; cp .config k/config; mv k "$CACHE/kernel"
    ) || { rm -rf "$s"; die "the kernel could not be built: see $CACHE/kernel.log"; }
    rm -rf "$s"
}

build_modules() {  # build_modules NAME VERSION: modules that Debian's kernel lacks, from its own source, into the cache
    b=$(mktemp -d "$CACHE/tmp.XXXXXX"); say "building $1 for $2"
    (exec >"$CACHE/$1.log" 2>&1
    common=$(echo "$2" | sed 's/-amd64$/-common/'); v=$(sed -n 's/^Version: //p' "$CACHE/linux/control")
    # Debian may publish a newer linux-kbuild before the signed kernel that belongs to it; its programs serve both.
    for p in "linux-headers-$2=$v" "linux-headers-$common=$v" linux-kbuild-6.1; do
        fetch "$p" "headers-$p"; cp -r "$CACHE/headers-$p/usr" "$b/"; rm -rf "$CACHE/headers-$p"
    done
    sed -i "s#/usr/src/#$b/usr/src/#" "$b/usr/src/linux-headers-$2/Makefile"
    "source_of_$1"; [ -e "$b/source" ]
    make -s -C "$b/usr/src/linux-headers-$2" M="$b/source" modules
    strip -g "$b"/source/*.ko; mkdir "$b/out"; cp "$b"/source/*.ko "$b/out/"; mv "$b/out" "$CACHE/$1"
    ) || { rm -rf "$b"; die "$1 could not be built: see $CACHE/$1.log"; }
    rm -rf "$b"
}

source_of_ctucan() {  # the driver of QEMU's CAN FD controller
    unpack_source "$b/s" --wildcards '*/drivers/net/can/ctucanfd/*'; mv "$b/s/drivers/net/can/ctucanfd" "$b/source"
    printf 'obj-m := ctucanfd.o ctucanfd_pci.o\nctucanfd-y := ctucanfd_base.o\n' > "$b/source/Makefile"
}

source_of_gpio_sim() {  # GPIO pins in software, with the simulated interrupts that they need
    unpack_source "$b/s" --wildcards '*/drivers/gpio/gpio-sim.c' '*/drivers/gpio/gpiolib.h' '*/kernel/irq/irq_sim.c'
    mkdir "$b/source"; mv "$b"/s/drivers/gpio/* "$b/s/kernel/irq/irq_sim.c" "$b/source/"
    mv "$b/source/gpio-sim.c" "$b/source/sim.c"
    # The kernel does not let modules call irq_to_desc; this gives the same answer.
    sed -i 's/irq_to_desc(irqnum)/irq_data_to_desc(irq_get_irq_data(irqnum))/' "$b/source/irq_sim.c"
    printf 'obj-m := gpio-sim.o\ngpio-sim-y := sim.o irq_sim.o\n' > "$b/source/Makefile"
}

setup_qemu() {
    command -v qemu-system-x86_64 >/dev/null || die "needs: apt-get install --no-install-recommends qemu-system-x86"
    setup_tools
    if [ ! -d "$CACHE/linux" ]; then
        p=$(apt-cache depends linux-image-amd64 | sed -n 's/.*Depends: \(linux-image-[^ ]*\)/\1/p' | head -1)
        [ -n "$p" ] || die "no package linux-image-amd64 is known: does \`apt-get update\` work?"
        fetch "$p" linux
    fi
    version=$(ls "$CACHE/linux/lib/modules"); d=$CACHE/linux/lib/modules/$version
    [ -e "$d/modules.dep" ] || "$CACHE/busybox/bin/busybox" depmod -b "$CACHE/linux" "$version"
    for m in ctucan gpio_sim; do [ -d "$CACHE/$m" ] || build_modules $m "$version"; done
    [ -e "$CACHE/vm/initrd" ] && return 0
    t=$(mktemp -d "$CACHE/tmp.XXXXXX"); mkdir -p "$t/r/m" "$t/r/proc" "$t/r/sys" "$t/r/dev" "$t/r/lower" "$t/r/up"
    cp "$CACHE/busybox/bin/busybox" "$t/r/"
    i=100
    for f in $(loading_order "$d" virtio_pci 9pnet_virtio 9p virtio_console $MODULES kvaser_pci) \
        "$CACHE/ctucan/ctucanfd.ko" "$CACHE/ctucan/ctucanfd_pci.ko"; do
        cp "$f" "$t/r/m/$i-$(basename "$f")"; i=$((i+1))
    done
    cat > "$t/r/init" <<'INIT'
#!/busybox sh
/busybox mount -t proc proc /proc; /busybox mount -t devtmpfs dev /dev
for f in /m/*.ko; do /busybox insmod $f; done
/busybox mount -t 9p -o trans=virtio,version=9p2000.L,ro,cache=loose,msize=262144 root /lower
g=$(/busybox sed "s/.*vmguest=\([^ ]*\).*/\1/" /proc/cmdline); . /lower$g
INIT
    chmod 755 "$t/r/init"
    (cd "$t/r"; b=$CACHE/busybox/bin/busybox; "$b" find . | "$b" cpio -o -H newc > ../initrd 2>/dev/null); rm -rf "$t/r"
    python3 - "$CACHE/linux/boot/vmlinuz-$version" "$t/vmlinux" <<'PY'
import lzma, sys   # unpacked here once: it would take 2.5 s in every boot
z = open(sys.argv[1], 'rb').read()
open(sys.argv[2], 'wb').write(lzma.LZMADecompressor(lzma.FORMAT_XZ).decompress(z[z.index(b'\xfd7zXZ\0'):]))
PY
    chmod 755 "$t"; mv "$t" "$CACHE/vm"
}

is_ready() {
    [ -d "$CACHE/busybox" ] && [ -d "$CACHE/can-utils" ] || return 1
    case $1 in
        uml) [ -x "$CACHE/kernel/linux" ] || [ -e "$CACHE/uml/mods" ] ;;
        kernel) [ -x "$CACHE/kernel/linux" ] ;;
        qemu) command -v qemu-system-x86_64 >/dev/null && [ -e "$CACHE/vm/initrd" ] && [ -d "$CACHE/gpio_sim" ] ;;
        *) die "no such engine: $1" ;;
    esac
}

if [ -n "$ready" ]; then is_ready "$ready" && exit 0; exit 1; fi
wanted=${setup:-$engine}
case $wanted in uml | kernel | qemu) ;; *) die "no such engine: $wanted" ;; esac
mkdir -p "$CACHE"; CACHE=$(cd "$CACHE" && pwd -P)
is_ready "$wanted" || (flock 9; "setup_$wanted") 9>"$CACHE/lock"
[ -z "$setup" ] || exit 0
[ $# -gt 0 ] || die "no command"

# ---- One run: all it needs lies in $C, which the guest sees; the guest writes into $O ------------------------------

quote() { printf "'"; printf %s "$1" | sed "s/'/'\\\\''/g"; printf "' "; }

C=$(mktemp -d /tmp/vm.XXXXXX); chmod 755 "$C"; BB=$CACHE/busybox/bin/busybox
O=$(mktemp -d /dev/shm/vm.XXXXXX 2>/dev/null) || O=$(mktemp -d /tmp/vm.XXXXXX)
machine='' reader=''
trap 'for p in $machine $reader; do kill $p 2>/dev/null || :; done; rm -rf "$C" "$O"' EXIT
trap 'exit 130' INT; trap 'exit 143' TERM HUP
mkdir "$C/ctl"; : > "$C/console"; : > "$O/out"; : > "$O/err"
{
    echo '#!/bin/sh'; export -p
    echo "export PYTHONDONTWRITEBYTECODE=1 MSBOT_VM=$engine MSBOT_CAN_HW=$hardware"
    echo "PATH=\$PATH:$(quote "$CACHE/can-utils/usr/bin")"
    # Each write of an unbuffered stream is a system call, and those are dear here.
    echo 'unset TMPDIR PYTHONUNBUFFERED'
    echo "cd $(quote "$(pwd -P)")"; printf 'exec '; for a; do quote "$a"; done; echo
} > "$C/cmd"

# The guest's side, on the bare kernel (uml: root is hostfs; qemu: an initial RAM disk with the root on /lower).
{
    if [ $engine = uml ]; then
        echo "#!$BB sh"; echo "B=$BB"; echo '$B mount -t proc proc /proc; $B mount -t devtmpfs dev /dev 2>/dev/null'
        [ -x "$CACHE/kernel/linux" ] || while read -r m; do echo "\$B insmod $m"; done < "$CACHE/uml/mods"
        echo "D=/mnt LOW=/ OUT=/mnt/r$C/ctl/out ERR=/mnt/r$C/ctl/err"
    else
        echo 'B=/busybox D=/up LOW=/lower; OUT=$(echo /dev/vport*p1) ERR=$(echo /dev/vport*p2)'
    fi
    cat <<'GUEST'
$B mount -t tmpfs -o size=100%,mode=755 up $D; $B mkdir $D/u $D/w $D/r
$B mount -t overlay -o lowerdir=$LOW,upperdir=$D/u,workdir=$D/w ov $D/r
R=$D/r
$B mount -t proc proc $R/proc; $B mount -t sysfs sys $R/sys
$B mount -t devtmpfs dev $R/dev; $B mount -t tmpfs run $R/run
$B mkdir -p $R/dev/pts $R/dev/shm
$B mount -t devpts -o ptmxmode=666 pts $R/dev/pts; $B mount -t tmpfs -o mode=1777 shm $R/dev/shm
$B ln -sf /proc/self/fd $R/dev/fd
GUEST
    i=0
    printf '%s' "$writable$O
" | while read -r w; do
        i=$((i+1)) m=$w o=''; [ "$w" != "$O" ] || { m=$C/ctl; o=sync,; }
        if [ $engine = uml ]; then echo "\$B mount -t hostfs -o $o$(quote "$w") none \$R$(quote "$m")"
        else echo "\$B mount -t 9p -o trans=virtio,version=9p2000.L,cache=mmap,msize=262144 w$i \$R$(quote "$m")"; fi
    done
    cat <<GUEST
for i in 0 1; do \$B chroot \$R ip link add vcan\$i type vcan; \$B chroot \$R ip link set vcan\$i mtu 72 up; done
\$B chroot \$R ip link set lo up; \$B hostname vm
[ $verbose = 0 ] || \$B sed 's/ .*/ s: guest is ready/' /proc/uptime > /dev/console
{ { \$B chroot \$R /bin/sh $C/cmd </dev/null 2>&3 3>&- 4>&-; echo \$? > \$R$C/ctl/status
} 3>&1 >&4 4>&- | \$B cat >> \$ERR; } 4>&1 | \$B cat >> \$OUT
\$B sync
[ $verbose = 0 ] || \$B sed 's/ .*/ s: done/' /proc/uptime > /dev/console
\$B poweroff -f
GUEST
} > "$C/guest"; chmod 755 "$C/guest" "$C/cmd"

# Passes on what the guest has written until $O/end is there and all is read.
python3 -S -E -c 'import os, sys, time
d = sys.argv[1]; f = [(open(d + "/out", "rb", 0), 1), (open(d + "/err", "rb", 0), 2)]
while True:
    end = os.path.exists(d + "/end"); n = 0
    for i, o in f:
        b = i.read(1 << 16); n += len(b)
        while b: b = b[os.write(o, b):]
    if not n:
        if end: break
        time.sleep(0.01)' "$O" & reader=$!

run_uml() {
    kernel=$CACHE/kernel/linux t=/tmp
    [ -x "$kernel" ] || { kernel=$CACHE/uml/usr/bin/linux.uml; [ -z "$travel" ] || die "-T needs --setup kernel"; }
    free=$(df -Pm /dev/shm 2>/dev/null | awk 'NR==2{print $4}'); [ "${free:-0}" -lt $((memory+64)) ] || t=/dev/shm
    # One core only: between two of them every system call of the guest takes three times as long.
    cpu=$(awk -v n=$$ '/^Cpus_allowed_list/ { m = split($2, a, ",")
        for (i = 1; i <= m; i++) { e = split(a[i], b, "-"); for (j = b[1]; j <= b[e]; j++) c[k++] = j }
        print c[n % k] }' /proc/self/status)
    TMPDIR=$t timeout -k 5 "$patience" taskset -c "$cpu" "$kernel" mem=${memory}M uml_dir="$C" umid=u \
        rootfstype=hostfs rootflags=/ ro init="$C/guest" quiet loglevel=3 $travel con=null con0=null,fd:3 \
        </dev/null 3>>"$C/console" >"$C/boot" 2>&1 & machine=$!
}

run_qemu() {
    set --; i=0
    case $hardware in kvaser | both)
        set -- "$@" -object can-bus,id=b0 -device kvaser_pci,canbus=b0 -device kvaser_pci,canbus=b0 ;; esac
    case $hardware in ctucan | both)
        set -- "$@" -object can-bus,id=b1 -device ctucan_pci,canbus0=b1,canbus1=b1 ;; esac
    IFS='
'
    for w in $writable $O; do
        i=$((i+1)); set -- "$@" -fsdev "local,id=w$i,path=$w,security_model=none,multidevs=remap" \
            -device "virtio-9p-pci,fsdev=w$i,mount_tag=w$i"
    done
    unset IFS
    # One processor: emulating two, which may touch one memory at any moment, costs nearly twice as much for the same work.
    # The clock is the HPET, whose rate is given: the TSC's is measured while the kernel starts, and on a busy computer that
    # was wrong at times (a clock that goes three times too fast, so that everything is late).
    timeout -k 5 "$patience" qemu-system-x86_64 -accel tcg,thread=multi,tb-size=256 -M q35 -cpu max -smp 1 \
        -m "$memory" -nodefaults -no-user-config -display none -monitor none -no-reboot \
        -kernel "$CACHE/vm/vmlinux" -initrd "$CACHE/vm/initrd" \
        -append "console=ttyS0 quiet loglevel=3 panic=-1 mitigations=off tsc=reliable clocksource=hpet vmguest=$C/guest" \
        -serial file:"$C/console" -chardev file,id=out,path="$O/out" -chardev file,id=err,path="$O/err" \
        -device virtio-serial-pci,id=vs -device virtserialport,bus=vs.0,nr=1,chardev=out \
        -device virtserialport,bus=vs.0,nr=2,chardev=err \
        -fsdev local,id=root,path=/,security_model=none,readonly=on,multidevs=remap \
        -device virtio-9p-pci,fsdev=root,mount_tag=root "$@" </dev/null >"$C/boot" 2>&1 & machine=$!
}

status=0
"run_$engine"
wait $machine || status=$?; machine=''
: > "$O/end"; wait $reader || :; reader=''
[ $verbose = 0 ] || cat "$C/console" >&2
if [ $status = 124 ] || [ $status = 137 ]; then echo "run-in-vm: not done after $patience s" >&2; exit 124; fi
answer=$(cat "$O/status" 2>/dev/null || :)
[ -n "$answer" ] || { cat "$C/boot" "$C/console" >&2; die "the machine ended without a status ($engine, $status)"; }
exit "$answer"
