#!/bin/sh
# Makes the images that printer/card/tests reads, with the Debian packages dosfstools, mtools and fdisk: programs that know nothing of
# Ferrostep. For each image there is mtools' own list of it.
set -eu
cd "$(dirname "$0")"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export TZ=UTC MTOOLS_SKIP_CHECK=1
seq -f 'G1 X%g Y10 F3000' 1 400 > "$work/lines.gcode"
head -c 1000 "$work/lines.gcode" > "$work/part.gcode"
printf 'G28\nM105\n' > "$work/short.gcode"
: > "$work/empty.gcode"
find "$work" -type f -exec touch -d '2024-02-29 12:34:56' {} +

fill() {
    mcopy -m -i "$1" "$work/short.gcode" ::/A.GCO
    mcopy -m -i "$1" "$work/lines.gcode" "::/A cube with a long name.gcode"
    mcopy -m -i "$1" "$work/part.gcode" "::/Würfel größer 中文 und noch mehr Text.gcode"
    mcopy -m -i "$1" "$work/empty.gcode" ::/EMPTY.G
    mcopy -m -i "$1" "$work/part.gcode" ::/README.TXT
    mcopy -m -i "$1" "$work/part.gcode" "::/._A cube with a long name.gcode"
    mcopy -m -i "$1" "$work/part.gcode" ::/HIDDEN.GCO
    mattrib -i "$1" +h ::/HIDDEN.GCO
    mcopy -m -i "$1" "$work/part.gcode" ::/LOCKED.GCO
    mattrib -i "$1" +r ::/LOCKED.GCO
    mmd -i "$1" ::/PARTS "::/Parts of the machine" "::/Parts of the machine/Left side" ::/PARTS/DEEP
    mcopy -m -i "$1" "$work/lines.gcode" ::/PARTS/ONE.GCO
    mcopy -m -i "$1" "$work/part.gcode" ::/PARTS/DEEP/TWO.GCO
    mcopy -m -i "$1" "$work/lines.gcode" "::/Parts of the machine/Left side/Bracket, thick.gcode"
    # A folder of more than one cluster, with gaps: every third file is deleted.
    mmd -i "$1" ::/MANY
    for number in $(seq 1 60); do
        mcopy -m -i "$1" "$work/short.gcode" "::/MANY/File number $number with a name.gcode"
    done
    for number in $(seq 3 3 60); do
        mdel -i "$1" "::/MANY/File number $number with a name.gcode"
    done
    # A file in the gaps: its clusters do not follow each other.
    mcopy -m -i "$1" "$work/lines.gcode" ::/MANY/GAPS.GCO
    mdir -i "$1" -/ -a :: > "$2.mdir"
}

# FAT16 on a card without partitions.
mkfs.fat -F 16 -s 1 -S 512 -i 12345678 -n SMALL -C "$work/fat16.img" 4096 > "$work/log" 2>&1
fill "$work/fat16.img" fat16

# FAT32 in the first partition of a card, as the SD Association's formatter makes it.
truncate -s 40M "$work/fat32.img"
printf 'label: dos\nlabel-id: 0x12345678\nstart=2048, type=c\n' | sfdisk -q "$work/fat32.img"
mkfs.fat -F 32 -s 1 -S 512 -i 12345678 -n CARD --offset 2048 "$work/fat32.img" 38912 > "$work/log" 2>&1
fill "$work/fat32.img@@1M" fat32

for name in fat16 fat32; do
    gzip -9nc "$work/$name.img" > "$name.img.gz"
done
