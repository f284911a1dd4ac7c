# A study's answers as a table, and the curves of its fits: Rscript answers.R [API] [STUDY].
# Needs httr2 and readr. TOKEN in the environment is sent where the server asks for one (its scopes: results and data).

library(httr2)
library(readr)

given <- commandArgs(trailingOnly = TRUE)
api <- if (length(given) > 0) given[1] else "http://127.0.0.1:8080/api/v1"
study <- if (length(given) > 1) given[2] else "driving"
token <- Sys.getenv("TOKEN")

ask <- function(...) {
  asked <- request(api) |>
    req_url_path_append("studies", study, ...) |>
    req_retry(max_tries = 3) |>
    req_error(body = function(answer) resp_body_json(answer, check_type = FALSE)$detail)
  if (nzchar(token)) req_auth_bearer_token(asked, token) else asked
}

# Everything in one stream.
answers <- ask("answers.csv") |> req_perform() |> resp_body_raw() |> read_csv(show_col_types = FALSE)
counted <- answers[answers$status == "answered", ]
print(round(prop.table(table(counted$problem, counted$action), margin = 1), 2))

# The same page by page: the header `Link` leads on.
pages <- ask("answers") |>
  req_url_query(limit = 500) |>
  req_perform_iterative(
    next_req = function(answer, asked) {
      after <- resp_body_json(answer)$`next`
      if (is.null(after)) NULL else req_url_query(asked, after = after)
    },
    max_reqs = Inf
  )
rows <- sum(vapply(pages, function(page) length(resp_body_json(page)$answers), integer(1)))
stopifnot(rows == nrow(answers))

# One row per point of a curve, for a figure.
summary <- ask("summary") |> req_perform()
states <- vapply(resp_body_json(summary)$fits, function(fit) fit$state, character(1))
if (any(states == "converged")) {
  curves <- ask("curves") |> req_perform() |> resp_body_json(simplifyVector = TRUE, simplifyDataFrame = FALSE)
  points <- do.call(rbind, lapply(curves$plans, function(part) {
    do.call(rbind, lapply(names(part$models), function(name) {
      data.frame(plan = part$plan, part = part$part, model = name, part$models[[name]]$value_logits)
    }))
  }))
  print(head(points))
}

# Nothing is sent twice: 304 says that the summary is still the same.
again <- ask("summary") |> req_headers(`If-None-Match` = resp_header(summary, "ETag")) |> req_perform()
cat(if (resp_status(again) == 304) "summary unchanged\n" else "summary changed meanwhile\n")
