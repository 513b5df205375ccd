# Analyse the recordings of a folder on a server and write the tables: Rscript batch.R FOLDER ADDRESS
#
# ACROMION_SECRET is the content of acromion-data/secret or, with accounts, a token. Each file is named after its
# subject code: S01.gt3x. A second call reuses what exists. Needs the packages httr2 and jsonlite.

arguments <- commandArgs(trailingOnly = TRUE)
folder <- arguments[1]
server <- httr2::request(arguments[2])
secret <- trimws(Sys.getenv("ACROMION_SECRET"))
if (nzchar(secret)) server <- httr2::req_auth_bearer_token(server, secret)
server <- httr2::req_error(server, body = function(answer) httr2::resp_body_json(answer, check_type = FALSE)$fix)

ask <- function(path) httr2::req_perform(httr2::req_url_path(server, path))

send <- function(path) {
  # Store a recording and return its id; bytes that were stored in the last 24 h are not stored again.
  sent <- httr2::req_url_path(server, "/api/v1/recordings")
  sent <- httr2::req_url_query(sent, file_name = basename(path), subject = tools::file_path_sans_ext(basename(path)))
  httr2::resp_body_json(httr2::req_perform(httr2::req_body_file(sent, path)))$id
}

files <- sort(list.files(folder, "\\.gt3x$", full.names = TRUE))
items <- lapply(files, function(path) list(recording_id = send(path)))
body <- list(name = basename(folder), settings = list(pose_held = "start"), items = items)
asked <- httr2::req_body_json(httr2::req_url_path(server, "/api/v1/batches"), body)
batch <- httr2::resp_body_json(httr2::req_perform(asked))
while (!batch$is_over) {
  Sys.sleep(2)
  batch <- httr2::resp_body_json(ask(batch$links$self))
}
for (name in c("summary", "problems")) {
  table <- httr2::resp_body_raw(ask(batch$links[[paste0(name, "_csv")]]))
  writeBin(table, file.path(folder, paste0(name, ".csv")))
}
print(unlist(batch$counts))
