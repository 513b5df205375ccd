# From the results of "acromion run" to the table, the figure and the methods of a paper, in base R:
#
#   Rscript paper.R OUT

out <- commandArgs(trailingOnly = TRUE)[1]
figures <- c("time_above_30_percent", "time_above_60_percent", "time_above_90_percent", "elevation_p50_deg")
days <- read.csv(file.path(out, "days.csv"), colClasses = c(subject = "character"), na.strings = "",
                 encoding = "UTF-8")
right <- subset(days, side == "right" & verdict != "poor" & is.na(left_out))
if (nrow(right) == 0) {
  message("No day of a right arm counts: see left_out and verdict in days.csv, and problems.csv.")
  quit(status = 1)
}
right$job_title[is.na(right$job_title)] <- "not stated"
stopifnot(!anyDuplicated(right[c("subject", "day")])) # a day of a person counts once

summarise <- function(rows, figure) {
  # Return people, days, mean of the people's means with its range, and the deviations between and within people.
  rows <- rows[!is.na(rows[[figure]]), ]
  values <- split(rows[[figure]], rows$subject)
  means <- sapply(values, mean)
  a <- length(values)
  n <- lengths(values)
  within <- sum(sapply(values, function(v) sum((v - mean(v))^2))) / (sum(n) - a)
  between <- sum(n * (means - mean(rows[[figure]]))^2) / (a - 1)
  typical <- (sum(n) - sum(n^2) / sum(n)) / (a - 1)
  half <- qt(0.975, a - 1) * sd(means) / sqrt(a)
  data.frame(figure = figure, people = a, days = sum(n), mean = mean(means), low = max(mean(means) - half, 0),
             high = mean(means) + half, sd_between = sqrt(max((between - within) / typical, 0)),
             sd_within = sqrt(within))
}

table <- do.call(rbind, lapply(split(right, right$job_title), function(rows) {
  cbind(job = rows$job_title[1], do.call(rbind, lapply(figures, function(name) summarise(rows, name))))
}))
write.csv(table, "table_r.csv", row.names = FALSE)
print(table, row.names = FALSE, digits = 3)

png("figure_r.png", width = 1400, height = 1000, res = 200)
means <- sort(tapply(right$time_above_60_percent, right$subject, mean))
plot(right$time_above_60_percent, match(right$subject, names(means)), yaxt = "n", ylab = "", pch = 19,
     xlab = "time above 60 deg, % (dots: days, bars: means)")
points(means, seq_along(means), pch = "|")
axis(2, seq_along(means), names(means), las = 1)
invisible(dev.off())

file.copy(file.path(out, "methods.md"), "methods_r.md", overwrite = TRUE)
