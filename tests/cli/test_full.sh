# A disk that takes no more (here: files may not grow): render says so once, goes on and gives the
# frame that it would have given; bake ends; what was committed before stays whole.
. "$ROOT/tests/cli/lib.sh"
render=("$SCENES/cornell.glb" "${quick[@]}" --png)
kl render "${render[@]}" --cache quiet.klc --out quiet.exr >/dev/null
most=$(($(stat -c %s quiet.klc/b-*) * 3 / 4096)) # KiB: enough for batches and the frame, not for the base
limited() {
    (
        trap '' XFSZ
        ulimit -f "$most"
        kl "$@"
    )
}
limited render "${render[@]}" --cache c.klc --out c.exr >/dev/null 2>warning
(($(grep -c 'warning: c.klc: records are not kept any more: .*File too large' warning) == 1)) || fail "warning"
same_image c.exr quiet.exr
kl cache check c.klc >/dev/null
exits 2 limited bake "${render[@]}" --cache d.klc >/dev/null 2>&1
kl cache check d.klc >/dev/null
kl render "${render[@]}" --cache d.klc --out d.exr | grep -q ', 0 added' || fail "batches were lost"
