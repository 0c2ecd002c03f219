#!/usr/bin/env bash
# Guess: `snakemake --profile P --config one=1` adds to, or overrides single values of, the `config:` of the profile.
# Seen (snakemake 9.27.1): it drops all of the profile's `config:`, as list or as mapping, without a word: a value that
# the profile gave is unknown to the rules, or silently the Snakefile's own default. `--configfile` beside the profile
# keeps it. A name of one letter (`--config n=1`) is refused as no valid identifier.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q snakemake==9.27.1
cd "$folder"
mkdir profile
printf 'config:\n  partition: long\ncores: 1\n' > profile/config.yaml
printf 'rule all:\n    output: "out"\n    params: p=config.get("partition", "default"), c=config.get("campaign", "none")\n    shell: "echo {params.p} {params.c} > out"\n' > Snakefile
printf '{"campaign": "jumps"}\n' > given.json
ask() { rm -f out; venv/bin/snakemake --quiet all --profile profile "$@" > log 2>&1 || { cat log; echo "failed: $*"; exit 1; }; cat out; }
alone=$(ask)
option=$(ask --config campaign=jumps)
file=$(ask --configfile given.json)
echo "profile alone: $alone | with --config: $option | with --configfile: $file"
[ "$alone" = "long none" ]
[ "$option" = "default jumps" ]  # the profile's partition is gone
[ "$file" = "long jumps" ]
rm -f out
if venv/bin/snakemake --quiet all --profile profile --config n=1 > log 2>&1; then echo "a name of one letter is taken now"; exit 1; fi
grep -q "valid identifier" log
