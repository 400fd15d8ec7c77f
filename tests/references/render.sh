#!/bin/sh
# Renders the reference images of this folder with the Mitsuba-based renderer of the same scene files.
#
#   render.sh ORACLE_PY [NAME...]      all references, or those named
#
# Needs Python with mitsuba and numpy, and LLVM for the llvm_ad_rgb variant. One image takes minutes.
set -eu
[ $# -ge 1 ] || { sed -n 's/^# \{0,1\}//; 2,6p' "$0" >&2; exit 2; }
oracle=$1; shift
here=$(cd "$(dirname "$0")" && pwd)
scenes=$here/../../scenes
only=" $* "

ref() {  # NAME SCENE BOUNCES SPP BATCHES
    case "$only" in "  " | *" $1 "*) ;; *) return 0 ;; esac
    printf '%-16s ' "$1"
    python3 "$oracle" "$2" "$here/$1.exr" --var "$here/$1.var.exr" --size 64 64 \
        --max-bounces "$3" --spp "$4" --batches "$5" --variant llvm_ad_rgb
}

# Mitsuba puts row i of a sky's h rows at v = i / (h - 1). Here rows are texels with their centres at
# v = (i + 1/2) / h. Sampled at 2h + 1 rows, the latter becomes the former without loss.
centred() {  # SKY.exr OUT.exr
    python3 - "$1" "$2" <<'PY'
import sys, numpy as np, mitsuba as mi
mi.set_variant("scalar_rgb")
a = np.array(mi.Bitmap(sys.argv[1]), np.float64)
h = len(a)
y = np.arange(2 * h + 1) / 2 - 0.5
i = np.floor(y).astype(int)
f = (y - i)[:, None, None]
a = a[np.clip(i, 0, h - 1)] * (1 - f) + a[np.clip(i + 1, 0, h - 1)] * f
mi.Bitmap(a.astype(np.float32)).write(sys.argv[2])
PY
}

ref box-n0 "$scenes/cornell-box.toml" 0 1048576 256
ref box-n1 "$scenes/cornell-box.toml" 1 524288 256
ref box-n4 "$scenes/cornell-box.toml" 4 524288 256
ref caustic-n4 "$scenes/cornell-caustic.toml" 4 524288 256
ref glass-n8 "$scenes/cornell-glass.toml" 8 262144 128
ref phong-n4 "$scenes/cornell-phong.toml" 4 262144 128
ref smooth-n3 "$scenes/smooth.toml" 3 131072 128
ref sky-n4 "$scenes/textured-sky.toml" 4 131072 128

tmp=$(mktemp -d)
trap 'rm -rf "$tmp"' EXIT
cp "$scenes"/textured-sky.* "$tmp"
centred "$scenes/textured-sky.exr" "$tmp/textured-sky.exr"
ref sky-n4-centred "$tmp/textured-sky.toml" 4 131072 128
