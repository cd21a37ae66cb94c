# A reed bends in a still room: its records bend along, and all are carried with a fifth of the rays and light as good as rebuilt, also
# while the shutter is open.
. "$ROOT/tests/cli/lib.sh"
scene=("$SCENES/reed.glb" --size 32x32 --spp 16 --error 0.06 --rays 64 --device embree --progress off --cache-mode off)

# rays FILE: gather rays of each frame of a report.
rays() {
    sed -n 's/^ *"gather": \([0-9]*\),\{0,1\}$/\1/p' "$1" | sed '$d'
}
# added FILE: records that were new in each frame of a report.
added() {
    sed -n 's/^ *"added": \([0-9]*\),\{0,1\}$/\1/p' "$1"
}
# error NAME FRAME: of the indirect light.
error() {
    kl compare "$1.$2.exr" "path.$2.exr" --layer diffuse_indirect --json=error.json >/dev/null
    value error.json relmse
}

for shutter in 0 0.5f; do
    open=(--shutter $shutter --overwrite)
    kl render "${scene[@]}" "${open[@]}" --frames 12-16 --moving carry --report carry.json --out carry.####.exr >/dev/null
    kl render "${scene[@]}" "${open[@]}" --frames 16 --report anew.json --out anew.####.exr >/dev/null
    kl render "${scene[@]}" "${open[@]}" --frames 16 --indirect path --spp 512 --out path.####.exr >/dev/null
    { rays carry.json | tail -n +2; rays anew.json; } | awk '{ r[NR] = $1 } END {
        exit !(r[4] > 0 && r[1] + r[2] + r[3] + r[4] < 4 * 0.2 * r[5]) }' || fail "shutter $shutter: too many rays"
    { added carry.json | tail -n +2; added anew.json; } | awk '{ n[NR] = $1 } END {
        exit !(n[1] + n[2] + n[3] + n[4] < 4 * 0.2 * n[5]) }' || fail "shutter $shutter: too many records are new"
    awk -v carried="$(error carry 0016)" -v anew="$(error anew 0016)" 'BEGIN { exit !(carried < 1.15 * anew) }' ||
        fail "shutter $shutter: carried light is worse"
done
