// SPDX-License-Identifier: Apache-2.0
"use strict";
const root = document.documentElement, theme = document.getElementById("theme"), share = document.getElementById("share");
const original = "<!DOCTYPE html>\n" + root.outerHTML;  // before anything is drawn or shown
function dark() {
  return (root.dataset.theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
}
function dress(wanted) {
  if (wanted) root.dataset.theme = wanted;
  theme.textContent = dark() ? "Light page" : "Dark page";
  for (const chart of charts) chart.redraw(false);
}
const charts = [];
theme.hidden = share.hidden = false;
theme.addEventListener("click", () => {
  const wanted = dark() ? "light" : "dark";
  try { localStorage.setItem("loco-theme", wanted); } catch (error) { /* a page without storage forgets */ }
  dress(wanted);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => dress(""));
function fileOf(text, name, kind) {
  return new File([text], `${name.toLowerCase().replaceAll(/[^a-z0-9]+/g, "_")}.${kind}`, { type: `text/${kind}` });
}
function download(file) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = file.name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
// By what the device shares files with; a device that shares none saves the file.
share.addEventListener("click", async () => {
  const file = fileOf(original, document.title, "html");
  try {
    if (!navigator.canShare?.({ files: [file] })) throw new Error("shares no files");
    await navigator.share({ files: [file], title: document.title });
  } catch (error) {
    if (error.name !== "AbortError") download(file);
  }
});
function add(parent, tag, className, text) {
  const made = parent.appendChild(document.createElement(tag));
  made.className = className;
  if (text !== undefined) made.textContent = text;
  return made;
}
// The animation stands still at the time under the pointer of a plot, where the browser can take it apart.
const movie = document.querySelector("img.movie"), still = document.createElement("canvas");
let pictures = null;
async function showMoment(t) {
  if (!movie || !window.ImageDecoder) return;
  if (!pictures) {
    pictures = new ImageDecoder({ data: (await fetch(movie.src)).body, type: "image/gif" });
    still.className = "movie"; movie.after(still);
  }
  await pictures.completed;
  const { start, end } = movie.dataset, last = pictures.tracks.selectedTrack.frameCount - 1;
  const at = t == null ? -1 : Math.round((t - start) / (end - start) * last);
  movie.hidden = at >= 0 && at <= last; still.hidden = !movie.hidden;
  still.dataset.at = at;
  if (still.hidden) return;
  const { image } = await pictures.decode({ frameIndex: at });
  if (Number(still.dataset.at) === at) {  // the pointer has not gone on
    still.width = image.displayWidth; still.height = image.displayHeight;
    still.getContext("2d").drawImage(image, 0, 0);
  }
  image.close();
}
// The case that the address names, in the panel of cases.
function showCase() {
  const panel = document.getElementById("case"), stored = document.getElementById("cases");
  if (!panel) return;
  const all = JSON.parse(stored.textContent);
  let name = "";
  try { name = decodeURIComponent(location.hash.replace("#case-", "")); } catch (error) { /* no name */ }
  if (!Object.hasOwn(all, name)) return;
  const table = document.createElement("table");
  table.className = "facts";
  for (const [key, value] of Object.entries({ case: name, ...all[name] })) {
    const row = table.insertRow();
    add(row, "th", "", key);
    row.insertCell().textContent = value;
  }
  panel.replaceChildren(table);
  panel.classList.add("shown");
  const close = add(panel, "button", "", "Close");
  close.type = "button";
  close.addEventListener("click", () => {
    panel.classList.remove("shown");
    history.replaceState(null, "", location.pathname);
  });
}
addEventListener("hashchange", showCase);
showCase();
let kept = "";
try { kept = localStorage.getItem("loco-theme") || ""; } catch (error) { /* see above */ }
dress(kept);
