# While the shutter is open records are means over it: gathered alike by the host and by a device, for what moves as a whole and what
# bends, and kept apart from those of an instant.
. "$ROOT/tests/cli/lib.sh"
args=(--size 32x32 --spp 16 --error 0.06 --rays 256 --aov diffuse_indirect --progress off --overwrite)

# added FILE: how many were added, by its report.
added() {
    value "$1" records_added
}

for name in cornell-fast:4 reed:14; do
    scene=("$SCENES/${name%:*}.glb" "${args[@]}" --frames "${name#*:}")
    kl render "${scene[@]}" --shutter 1f --cache mean.klc --device embree --out host.exr --report host.json >/dev/null
    kl render "${scene[@]}" --shutter 1f --cache mean.klc --device embree --out again.exr --report again.json >/dev/null
    kl render "${scene[@]}" --cache mean.klc --device embree --out still.exr --report still.json >/dev/null
    [[ $(added host.json) != 0 && $(added again.json) == 0 && $(added still.json) != 0 ]] ||
        fail "$name: means and instants have records of their own"
    same_image host.exr again.exr >/dev/null
    rm -rf mean.klc
    code=0
    kl render "${scene[@]}" --shutter 1f --cache-mode off --device opencl --out device.exr --report device.json >/dev/null 2>&1 || code=$?
    if [[ $code == 2 ]]; then
        echo "SKIPPED: no OpenCL device"
        continue
    fi
    kl compare device.exr host.exr --layer diffuse_indirect --json=device.cmp >/dev/null
    awk -v error="$(value device.cmp relmse)" 'BEGIN { exit !(error < 1e-6) }' || fail "$name: the device differs"
done
