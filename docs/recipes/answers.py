"""A study's answers as a table, and the curves of its fits: answers.py [API] [STUDY].

Needs httpx and pandas. TOKEN in the environment is sent where the server asks for one (its scopes: results and data).
"""

import io
import os
import sys

import httpx
import pandas

API = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8080/api/v1"
STUDY = sys.argv[2] if len(sys.argv) > 2 else "driving"
HEADERS = {"Authorization": f"Bearer {os.environ['TOKEN']}"} if "TOKEN" in os.environ else {}


def get(client, url, **options):
    answer = client.get(url, **options)
    if answer.is_error:
        problem = answer.json()
        raise SystemExit(f"{problem['title']}: {problem['detail']} (request {problem.get('request_id')})")
    return answer


with httpx.Client(base_url=f"{API}/studies/{STUDY}/", headers=HEADERS, transport=httpx.HTTPTransport(retries=3)) as client:
    # Everything in one stream.
    answers = pandas.read_csv(io.BytesIO(get(client, "answers.csv").content))
    counted = answers[answers["status"] == "answered"]
    print(counted.groupby("problem")["action"].value_counts(normalize=True).unstack(fill_value=0).round(2))

    # The same page by page: the header `Link` leads on.
    rows, page = [], get(client, "answers", params={"limit": 500})
    while True:
        rows += page.json()["answers"]
        if "next" not in page.links:
            break
        page = get(client, httpx.URL(API).join(page.links["next"]["url"]))
    assert len(rows) == len(answers)

    # One row per point of a curve, for a figure.
    summary = get(client, "summary")
    if any(fit["state"] == "converged" for fit in summary.json()["fits"]):
        curves = get(client, "curves").json()
        points = pandas.concat(
            pandas.DataFrame(model["value_logits"]).assign(plan=part["plan"], part=part["part"], model=name)
            for part in curves["plans"]
            for name, model in part["models"].items()
        )
        print(points.head())

    # Nothing is sent twice: 304 says that the summary is still the same.
    again = get(client, "summary", headers={"If-None-Match": summary.headers["ETag"]})
    print("summary unchanged" if again.status_code == 304 else "summary changed meanwhile")
