# Helpers of the scripts: source it with `. "$ROOT/tests/cli/lib.sh"`.

kl() {
    "$KEEPLIGHT" "$@"
}

# Small and quick: arguments for render and bake.
quick=(--size 48x32 --spp 2 --preset draft --rays 64 --device embree --progress off)

fail() {
    echo "FAILED: $*"
    exit 99
}

# exits CODE COMMAND...: the command ends with this code.
exits() {
    local want=$1 code=0
    shift
    "$@" || code=$?
    [[ $code == "$want" ]] || fail "exit code $code, expected $want: $*"
}

# same_image A B: all that compare measures is zero.
same_image() {
    kl compare "$1" "$2" --json=.same.json
    [[ $(value .same.json max_abs) == 0.0 ]] || fail "$1 and $2 differ"
}

# value FILE KEY: the first number or word of a key in indented JSON.
value() {
    sed -n 's/^ *"'"$2"'": "\{0,1\}\([^",]*\)"\{0,1\},\{0,1\}$/\1/p' "$1" | head -n 1
}

# same_tree A B: the same files with the same bytes.
same_tree() {
    diff -r "$1" "$2" >/dev/null || fail "$1 and $2 differ"
}
