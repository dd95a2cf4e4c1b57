
"use strict";
// what the pages of ours share: asking the server, and pictures of cameras in which markers are seen, zoomed and clicked
const $ = id => document.getElementById(id);
const views = [];  // of each camera: { canvas, size, image, zoom, at }; `at` is the place in the middle
let busy = Promise.resolve(), seen = {}, work = "";  // seen: how many edits of each trial this page knows; work: where all is kept

// addresses are relative: they carry the token on
async function get(path, how) {
  let r;
  try { r = await fetch(path, how); } catch {
    document.body.dataset.ended = "1";
    throw work ? `The program has ended. All that it had said to be kept is in ${work}: start it again, and it goes on there.`
      : "The program has ended: its terminal says why.";
  }
  const answer = await r.json();
  if (answer.reload) $("reload").hidden = false;
  if (!r.ok) throw answer.said;
  return answer;
}
// what changes a trial says how many edits of it this page has seen; after that it has seen its own, too
async function post(path, trial, data) {
  const body = JSON.stringify({ ...data, trial, edits: seen[trial] ?? -1 });
  const answer = await get(path, { method: "POST", headers: { "Content-Type": "application/json" }, body });
  seen = { ...seen, ...answer.seen };
  $("said").textContent = answer.said;
  return answer;
}
// one after the other; what goes wrong is said
function queued(work) { busy = busy.then(work).catch(e => { $("said").textContent = String(e); }); return busy; }
function make(kind, text, more) { return Object.assign(document.createElement(kind), { textContent: text }, more); }

// a frame's number as people write it, also 1.200, 1,200, 1 200, 12,0 and 12.0
function whole(text) {
  const plain = text.trim().replace(/[.,\s\u00a0\u202f'’](?=\d{3}(\D|$))/g, "").replace(",", ".");
  const n = plain === "" ? NaN : Number(plain);
  if (!Number.isInteger(n)) throw `"${text}" is not the number of a frame`;
  return n;
}
// a number as people write it, also 99,5
function decimal(text) {
  const plain = text.trim().replace(",", "."), n = plain === "" ? NaN : Number(plain);
  if (!(n > 0)) throw `"${text}" is not a number above zero`;
  return n;
}
// a number to two digits, as people write it: 130, 13, 1.3
const twoDigits = x => String(Number(x.toPrecision(2)));
// whose pictures and numbers a page asks for
const ofTrial = () => `&trial=${encodeURIComponent(info.trial)}`;
// a camera's picture; `on` is told of presses, clicks and where the mouse is
function addView(box, name, size, on) {
  const film = make("div", "", { className: "film" }), canvas = document.createElement("canvas");
  canvas.id = "film" + views.length;
  film.append(canvas, make("span", name)); box.append(film);
  const v = { canvas, size, image: null, zoom: 1, at: [size[0] / 2, size[1] / 2], c: views.length };
  views.push(v);
  canvas.onmousedown = e => on.press(v, e);
  canvas.onclick = e => on.click(v, e);
  canvas.onmouseenter = () => on.enter(v);
  canvas.onwheel = e => { e.preventDefault(); zoomTo(v, v.zoom * (e.deltaY < 0 ? 1.25 : 0.8), place(v, e)); on.draw(); };
  return v;
}
function scale(v) { return v.zoom * Math.min(v.canvas.width / v.size[0], v.canvas.height / v.size[1]); }
function place(v, e) {  // column and row of the picture, its corner at (0, 0)
  const r = v.canvas.getBoundingClientRect(), s = scale(v);
  return [v.at[0] + (e.clientX - r.left - r.width / 2) / s, v.at[1] + (e.clientY - r.top - r.height / 2) / s];
}
function zoomTo(v, zoom, p) {  // the place p stays where it is
  const z = Math.min(40, Math.max(1, zoom));
  v.at = [p[0] + (v.at[0] - p[0]) * v.zoom / z, p[1] + (v.at[1] - p[1]) * v.zoom / z]; v.zoom = z;
}
// the marker whose mark is at a place of the screen (else another one), and that place
function near(v, e, marks, other) {
  const p = place(v, e);
  let best = { m: other, d: 8 / scale(v) };
  marks.forEach((x, m) => {
    const at = x.click || x.dot;
    if (at) { const d = Math.hypot(at[0] - 0.5 - p[0], at[1] - 0.5 - p[1]); if (d < best.d) best = { m, d }; }
  });
  return { m: best.m, x: e.clientX, y: e.clientY };
}
// whether a press was let go elsewhere
function dragged(held, e) { return held && Math.hypot(e.clientX - held.x, e.clientY - held.y) > 3; }
async function loadPictures(frame) {
  await Promise.all(views.map(async v => {
    const image = new Image(); image.src = `picture?camera=${v.c}&frame=${frame}${ofTrial()}`;
    try { await image.decode(); v.image = image; } catch { v.image = null; }
  }));
}
// a picture with the marks of all markers: { click, dot, ellipse, edited }, and the lines of one of them
function drawView(v, marks, lines, marker, names, bones) {
  const k = v.canvas, g = k.getContext("2d");
  k.width = k.clientWidth; k.height = k.clientHeight;
  const s = scale(v);
  g.setTransform(s, 0, 0, s, k.width / 2 - v.at[0] * s, k.height / 2 - v.at[1] * s);
  g.imageSmoothingEnabled = false;
  if (v.image) g.drawImage(v.image, 0, 0);
  g.translate(-0.5, -0.5);  // the centre of the first pixel is at (1, 1), its corner at (0.5, 0.5)
  g.lineWidth = 1 / s;
  const at = m => m && (m.click || m.dot || m.ellipse);
  g.strokeStyle = "#9ab8"; (bones || []).forEach(([a, b]) => {
    const from = at(marks[a]), to = at(marks[b]);
    if (from && to) { g.beginPath(); g.moveTo(from[0], from[1]); g.lineTo(to[0], to[1]); g.stroke(); }
  });
  g.font = `${12 / s}px system-ui`; g.shadowColor = "#000"; g.shadowBlur = 3;
  (names || []).forEach((name, i) => {
    const p = at(marks[i]); if (!p) return;
    g.fillStyle = i === marker ? "#fc6" : "#ccca"; g.fillText(name, p[0] + 9 / s, p[1] - 7 / s);
  });
  g.shadowBlur = 0;
  marks.forEach((m, i) => {
    const mine = i === marker, r = 6 / s;
    g.strokeStyle = mine ? "#fc6" : m.edited ? "#6f9" : "#6cf";
    if (m.click) { g.beginPath(); g.arc(m.click[0], m.click[1], r, 0, 7); g.stroke(); }
    if (m.dot) { g.strokeRect(m.dot[0] - r * 0.8, m.dot[1] - r * 0.8, r * 1.6, r * 1.6); }
    if (m.ellipse && (mine || !m.dot)) {
      const [u, w, a, b, turn] = m.ellipse;
      g.globalAlpha = mine ? 1 : 0.4; g.beginPath(); g.ellipse(u, w, Math.max(a, r), Math.max(b, r), turn, 0, 7); g.stroke();
      g.globalAlpha = 1;
    }
  });
  g.strokeStyle = "#f6c";
  lines.forEach(line => {
    g.beginPath(); line.forEach((p, i) => i ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])); g.stroke();
  });
}
