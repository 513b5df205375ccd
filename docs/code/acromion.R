# Acromion from R: the tables of a finished run, and an analysis over the API.
#
#   Rscript acromion.R OUT                        the tables in the folder OUT of "acromion run ... -o OUT"
#   Rscript acromion.R OUT shift.gt3x ADDRESS     and an analysis by a server, for example http://127.0.0.1:8080
#
# ACROMION_SECRET is the content of the file "secret" in the server's data folder (acromion-data/secret) or, with
# accounts, a token. If it is empty or absent, nothing is sent.
#
# Base R reads the tables; the API needs the packages httr2 and jsonlite.

read_table <- function(out, name = "summary") {
  # Return a table: "summary", "days", "hours", "periods", "tasks", "postures", "marks" or "pairs". Subject codes stay
  # text: "007" is not a number.
  path <- file.path(out, paste0(name, ".csv"))
  read.csv(path, colClasses = c(subject = "character"), na.strings = "", encoding = "UTF-8")
}

usable <- function(summary) {
  # Return the rows without failed recordings and poor data.
  summary[is.na(summary$error_code) & summary$verdict != "poor", ]
}

analyse <- function(path, address, ..., secret = Sys.getenv("ACROMION_SECRET")) {
  # Send a recording, wait for the analysis, and return its results.json as a list. "..." are settings:
  # subject = "S012", side = "right", calibration = "5,15".
  api <- httr2::request(paste0(address, "/api/v1"))
  if (nzchar(secret)) api <- httr2::req_auth_bearer_token(api, secret)
  sent <- httr2::req_url_path_append(api, "analyze")
  sent <- httr2::req_url_query(sent, file_name = basename(path), ...)
  sent <- httr2::req_headers(sent, Prefer = "wait=60")
  analysis <- httr2::resp_body_json(httr2::req_perform(httr2::req_body_file(sent, path)))
  while (analysis$state %in% c("queued", "running")) {
    asked <- httr2::req_url_query(httr2::req_url_path_append(api, "analyses", analysis$id), wait = 60)
    analysis <- httr2::resp_body_json(httr2::req_perform(asked))
  }
  if (analysis$state != "succeeded") stop(analysis$problem$fix)
  results <- httr2::req_url_path_append(api, "analyses", analysis$id, "results.json")
  httr2::resp_body_json(httr2::req_perform(results))
}

tabulate_time_above <- function(results) {
  # Return time at or above 30, 60 and 90 degrees with the ends of the 95 % range (NA if there is none).
  rows <- lapply(results$exposure$time_above, function(row) {
    ends <- lapply(row[c("low", "high")], function(end) if (is.null(end)) NA else end)
    data.frame(threshold_deg = row$threshold_deg, percent = row$percent, low = ends$low, high = ends$high)
  })
  do.call(rbind, rows)
}

arguments <- commandArgs(trailingOnly = TRUE)
if (length(arguments) >= 1) {
  good <- usable(read_table(arguments[1]))
  print(good[, c("subject", "analysed_s", "time_above_60_percent", "verdict")])
  print(nrow(read_table(arguments[1], "hours")))
}
if (length(arguments) == 3) print(tabulate_time_above(analyse(arguments[2], arguments[3], subject = "S014")))
