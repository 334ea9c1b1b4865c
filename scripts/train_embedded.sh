#!/bin/sh
# How the language model that comes along was made (docs/embedded.md): record, build, train, ship.
# Under two hours on two cores; what is there already is not made again.
#   scripts/train_embedded.sh FOLDER     (sandra[highway,local] must be on the PATH)
set -eu
folder=${1:?name a folder for recordings and training}
weights=$(dirname "$0")/../src/sandra/rankers/inside/weights
mkdir -p "$folder"

record() {
    name=$1 seed=$2 episodes=$3
    shift 3
    sandra dataset record --out "$folder/$name" --seed "$seed" --episodes "$episodes" \
        --workers auto "$@"
}

rows() {
    from=$1 out=$folder/$2.jsonl
    shift 2
    [ -f "$out" ] || sandra dataset build "$from" --out "$out" --workers auto "$@"
}

record rec 0 320
record rec1 320 200
record rec2 520 160
record rec4 1000 240 --environments merge,roundabout
rows "$folder/rec" h15 --horizon 15 --windows 8 --balance 1500 --variety 0.25
rows "$folder/rec1" h10 --horizon 10 --windows 6 --balance 1000 --variety 0.25
rows "$folder/rec2" h25 --horizon 25 --windows 6 --balance 1000 --variety 0.25
rows "$folder/rec4" lanes --horizon 15 --windows 8 --balance 400 --variety 0.25
rows "$folder/rec1" bare5 --horizon 5 --windows 3 --balance 500 --variety 0.1 --bare 0.7
rows "$folder/rec2" bare15 --horizon 15 --windows 3 --balance 500 --variety 0.1 --bare 0.7
rows "$(dirname "$0")/../src/sandra/scenarios" shipped --horizon 20 --windows 6 --variety 0.25

sandra finetune scratch "$folder/h15.jsonl" "$folder/h10.jsonl" "$folder/h25.jsonl" \
    "$folder/shipped.jsonl" --out "$folder/run" --steps 2100
sandra finetune scratch "$folder/h15.jsonl" "$folder/h10.jsonl" "$folder/h25.jsonl" \
    "$folder/lanes.jsonl" "$folder/bare5.jsonl" "$folder/bare15.jsonl" "$folder/shipped.jsonl" \
    --base "$folder/run/model" --out "$folder/more" --steps 850 --rate 1e-3 --prompt-weight 0.01
cp "$folder"/more/model/* "$folder/more/card.json" "$weights/"

# Held out: other seeds.
record held 5000 200
rows "$folder/held" held --horizon 15 --windows 4 --seed 1 --balance 60
sandra evaluate open-loop "$folder/held" --rows "$folder/held.jsonl" --split all \
    --label-horizon 15 --horizon 15 --ranker rules --ranker embedded --workers auto \
    --out "$folder/open-loop"
