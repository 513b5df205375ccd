// File sizes for display, in the language of the page.

export function formatSize(bytes, units) {
  const power = Math.min(3, bytes ? Math.floor(Math.log10(bytes) / 3) : 0);
  const digits = power >= 2 ? 1 : 0;
  const number = (bytes / 1000 ** power).toLocaleString(document.documentElement.lang, { minimumFractionDigits: digits, maximumFractionDigits: digits });
  return number + "\u00a0" + units[power];
}
