#!/bin/sh
# The first process of the guest kernel: virtual CAN buses, the job on them, and the end of the guest.
#
# The host's files are all there, and none can be written but those of the work folder, which is mounted on /mnt. A kernel that is
# a process gives no exit status, so it goes into a file, which appears whole. WORK, MODULES (the folder with
# the kernel's modules) and SECONDS_LEFT come from the kernel's command line.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin TMPDIR=/mnt HOME=/mnt

job() {
    for module in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/vcan; do
        insmod "$MODULES/$module.ko" || return 90
    done
    ip link set lo up
    # vcan0 carries frames of CAN FD too; vcan1 does not.
    ip link add dev vcan0 type vcan && ip link set vcan0 mtu 72 && ip link set vcan0 up || return 91
    ip link add dev vcan1 type vcan && ip link set vcan1 mtu 16 && ip link set vcan1 up || return 91
    timeout "$SECONDS_LEFT" sh /mnt/job.sh
}

mount -t proc proc /proc
mount -t sysfs sysfs /sys
# By the old interface of mount the folder is the whole option, by the new one (Debian 13) it has a name.
mount -t hostfs -o "$WORK" none /mnt 2>/dev/null || mount -t hostfs -o "hostfs=$WORK" none /mnt || echo "no work folder"
cd /mnt
job >/mnt/log 2>&1 </dev/null
echo $? >/mnt/status.new
sync
mv /mnt/status.new /mnt/status
sync
echo o >/proc/sysrq-trigger
sleep 10
