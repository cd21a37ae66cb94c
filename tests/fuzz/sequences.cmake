kl_fuzz(fuzz_ranges SOURCES fuzz_ranges.c LINK kl_sequences)
kl_fuzz(fuzz_path SOURCES fuzz_path.c LINK kl_sequences)
