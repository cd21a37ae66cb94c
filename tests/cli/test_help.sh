# Help goes to stdout and is a success.
. "$ROOT/tests/cli/lib.sh"
kl --help >help.txt
kl --version | grep -q '^keeplight [0-9]*\.[0-9]*\.[0-9]* (' || fail version
for command in render bake "cache info" "cache check" compare scene devices sheet; do
    grep -q "^  ${command%% *} " help.txt || fail "$command is not in the help"
    # shellcheck disable=SC2086 # two words
    kl $command --help >"help $command.txt"
    grep -q -- --help "help $command.txt" || fail "$command --help"
done
