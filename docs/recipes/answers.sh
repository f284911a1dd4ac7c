#!/usr/bin/env bash
# Takes a study's answers and the newest numbers of its fits with curl: recipes/answers.sh [API] [STUDY] [FOLDER].
# TOKEN in the environment is sent where the server asks for one (its scopes: results and data).
set -euo pipefail
api=${1:-http://127.0.0.1:8080/api/v1}
study=${2:-driving}
folder=${3:-.}

get() {
    curl --fail-with-body --silent --show-error --retry 3 ${TOKEN:+--header "Authorization: Bearer $TOKEN"} "$@"
}

# Everything in one stream.
get "$api/studies/$study/answers.csv" --output "$folder/answers.csv"

# The same page by page, as long as there is a next one.
after=
: > "$folder/answers.ndjson"
while :; do
    page=$(get "$api/studies/$study/answers?limit=100${after:+&after=$after}")
    printf '%s' "$page" | tr -d '\n' >> "$folder/answers.ndjson"
    echo >> "$folder/answers.ndjson"
    after=$(printf '%s' "$page" | sed -n 's/.*"next":"\([^"]*\)".*/\1/p')
    [ -n "$after" ] || break
done

# The summary only if it has changed: curl keeps the tag in a file and sends it along.
get "$api/studies/$study/summary" --etag-compare "$folder/summary.etag" --etag-save "$folder/summary.etag" \
    --output "$folder/summary.json"

# What will a person choose?
get "$api/studies/$study/predict" --header 'Content-Type: application/json' --output "$folder/prediction.json" --data '{
    "model": "noisy_rational", "parameters": {"theta": 0.2},
    "problem": {"stable": [[1, 20]], "unstable": [[0.2, 105], [0.8, 0]]}
}'
