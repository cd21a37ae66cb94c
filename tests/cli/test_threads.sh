# Any number of threads gives the same cache, byte for byte, and the same pictures.
. "$ROOT/tests/cli/lib.sh"
for n in 1 2 5; do
    kl render "$SCENES/still-life.glb" "${quick[@]}" --turntable 3 --out $n.####.exr --cache $n.klc \
        --threads $n >/dev/null
done
for n in 2 5; do
    same_tree 1.klc $n.klc
    for frame in 0001 0002 0003; do
        same_image 1.$frame.exr $n.$frame.exr >/dev/null
    done
done
