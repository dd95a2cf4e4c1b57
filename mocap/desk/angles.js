// quantities over time and the potential of a joint; this file owns which are shown, and their zoom
let curves = {}, shownQuantities = [], plotted = [], charts = [], way = null, extent = null;
const SIDE = { left: "--left", right: "--right", trunk: "--mid" };
const KINDS = { joint: "Joints", stroke: "Strokes", body: "Body", length: "Lengths", area: "Areas", mass: "Centres of mass", marker: "Speeds of markers" };
const color = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const rates = q => /\bacceleration\b/.test(q.title);

// one line for a quantity of both sides, in groups; accelerations where they are asked for
function choices() {
  const text = $("quantity").value.toLowerCase(), both = new Map();
  for (const q of info.quantities) {
    if (rates(q) && !$("accelerations").checked) continue;
    if (![q.title, q.either].some(x => x.toLowerCase().includes(text))) continue;
    const key = q.kind + " " + q.either + " " + q.unit;
    both.set(key, [...both.get(key) || [], q]);
  }
  const groups = new Map();
  for (const all of both.values()) groups.set(all[0].kind, [...groups.get(all[0].kind) || [], all]);
  $("quantities").replaceChildren(...[...groups].map(([kind, lines]) => {
    const set = document.createElement("fieldset");
    set.append(make("legend", KINDS[kind] || kind), ...lines.map(all => {
      const names = all.map(q => q.name), label = make("label", ""), on = names.every(n => shownQuantities.includes(n));
      label.append(make("input", "", { type: "checkbox", checked: on, value: names[0], onchange: e => {
        shownQuantities = e.target.checked ? [...shownQuantities, ...names] : shownQuantities.filter(n => !names.includes(n));
        queued(plot); } }), `${all.length > 1 ? all[0].either : all[0].title} (${all[0].unit})`);
      return label;
    }));
    return set;
  }));
}
// what is shown first: the joint that both sides have and that bends, else the first
function firstQuantities() {
  const bends = info.quantities.filter(q => /flexion$/.test(q.title)), first = bends[0] || info.quantities[0];
  return first ? info.quantities.filter(q => q.either === first.either && q.unit === first.unit).map(q => q.name) : [];
}
async function angles() {
  if (curves.trial !== info.trial) { curves = { trial: info.trial, seen: seen[info.trial] }; shownQuantities = firstQuantities(); extent = null; way = null; }
  choices(); await plot();
}
async function plot() {
  const names = [...shownQuantities]; // others may be ticked while these come
  await Promise.all(names.filter(n => !curves[n]).map(async n => { curves[n] = await get("curve?name=" + encodeURIComponent(n) + ofTrial()); }));
  plotted = names;
  const all = names.map(n => ({ ...info.quantities.find(q => q.name === n), ...curves[n] })), was = $("cycle").value;
  const of = [...new Set(all.flatMap(c => Object.keys(c.cycles)))];
  $("cycle").replaceChildren(make("option", "no cycles", { value: "" }), ...of.map(n => make("option", n, { value: n })));
  $("cycle").value = of.includes(was) ? was : of[0] || ""; $("cycle").disabled = !of.length; doubtable(all[0]);
  charts.forEach(c => c.destroy()); charts = [];
  if (!all.length) { $("charts").replaceChildren(make("p", "Tick a quantity on the left.")); return; }
  $("charts").replaceChildren();
  const known = all.flatMap(c => c.seconds.filter((_, i) => c.value[i] !== null));
  const whole = known.length ? [Math.min(...known), Math.max(...known)] : [0, 1];
  const units = [...new Set(all.map(c => c.unit))], high = Math.max(180, ($("plots").clientHeight - 60) / units.length - 70);
  charts = units.map(unit => chart(all.filter(c => c.unit === unit), unit, extent || whole, whole, high));
  document.body.dataset.curve = names[0];
}
function chart(all, unit, shownRange, whole, height) {
  const series = [{ label: "s" }], data = [all[0].seconds], bands = [];
  for (const c of all) {
    const ink = all.length === 1 ? color("--mid") : color(SIDE[c.side]), dash = all.filter(o => o.side === c.side).indexOf(c) ? [6, 3] : undefined, n = series.length;
    const plain = { stroke: "transparent", points: { show: false }, auto: false };
    series.push({ ...plain, label: c.title + " low", show: true }, { ...plain, label: c.title + " high" },
      { label: c.title + " filled", stroke: ink, width: 1, dash: [2, 3], points: { show: false } },
      { label: c.title, stroke: ink, width: 2, dash, points: { show: false }, value: (_, v) => v === null ? "–" : v.toPrecision(4) + " " + unit });
    bands.push({ series: [n + 1, n], fill: ink + "38" });
    const measured = c.value.map((v, i) => c.filled[i] ? null : v);
    data.push(c.low, c.high, c.value, measured);
  }
  const axis = { stroke: color("--text"), grid: { stroke: color("--line"), width: 1 }, ticks: { stroke: color("--line") }, font: "12px system-ui" };
  const options = {
    title: [...new Set(all.map(c => all.length > 2 || all.length === 1 ? c.title : c.either))].join(", ") + ` (${unit})`, width: $("charts").clientWidth, height, bands, series,
    scales: { x: { time: false, min: shownRange[0], max: shownRange[1] }, y: { range: (_, low, high) => {
      const room = 0.12 * (high - low || 1); return [low - room, high + room]; } } },
    axes: [{ ...axis, label: "seconds", labelSize: 18, size: 38 }, { ...axis, size: 62 }], legend: { show: true, live: true },
    cursor: { sync: { key: "time" }, drag: { x: true, y: false, setScale: true } },
    hooks: {
      drawClear: [u => beats(u)], draw: [u => now(u)],
      setScale: [(u, key) => { if (key === "x" && u.status === 1) zoomed(u, whole); }],
      ready: [u => { u.over.onclick = e => { if (Math.abs(e.clientX - u.pressed) < 3) toTime(u.posToVal(e.offsetX, "x")); };
        u.over.onmousedown = e => { u.pressed = e.clientX; }; }],
    },
  };
  const made = new uPlot(options, data, $("charts"));
  // of each quantity the legend has one entry
  made.root.querySelectorAll(".u-legend .u-series").forEach((row, i) => { if (i && (i - 1) % 4 < 3) row.style.display = "none"; });
  return made;
}
// all charts show the same time
function zoomed(u, whole) {
  const { min, max } = u.scales.x;
  extent = Math.abs(min - whole[0]) + Math.abs(max - whole[1]) < 1e-9 ? null : [min, max];
  charts.forEach(c => { if (c !== u && (c.scales.x.min !== min || c.scales.x.max !== max)) c.setScale("x", { min, max }); });
}
// cycles, every other one shaded, numbered
function beats(u) {
  const c = curves[plotted[0]], g = u.ctx, box = u.bbox;
  g.save(); g.fillStyle = color("--quiet"); g.font = `${12 * devicePixelRatio}px system-ui`; g.textAlign = "center"; g.textBaseline = "top";
  (c.cycles[$("cycle").value] || []).forEach((ends, i) => {
    const [a, b] = ends.map(s => u.valToPos(s, "x", true));
    const left = Math.max(a, box.left), right = Math.min(b, box.left + box.width);
    if (right <= left) return;
    if (i % 2) { g.globalAlpha = 0.12; g.fillRect(left, box.top, right - left, box.height); g.globalAlpha = 1; }
    const doubtful = (c.doubtful[$("cycle").value] || {})[i];
    if (doubtful) { g.globalAlpha = 0.15; g.fillStyle = color("--bad"); g.fillRect(left, box.top, right - left, box.height); g.fillStyle = color("--quiet"); g.globalAlpha = 1; }
    if (right - left > 16 * devicePixelRatio) g.fillText(i + 1 + (doubtful ? "?" : ""), (left + right) / 2, box.top + 3);
  });
  g.restore();
}
// to the next beat after this frame that is not counted, and why it is not
function doubt() {
  const c = curves[plotted[0]], of = $("cycle").value, all = c && c.doubtful[of];
  if (!all || !Object.keys(all).length) return;
  const starts = Object.keys(all).map(i => [...c.cycles[of][i], all[i], Number(i)]), here = timeOf(c);
  const [a, b, why, i] = starts.find(([from]) => from > here + 1e-9) || starts[0];
  extent = [a - (b - a), b + (b - a)];
  queued(async () => { await plot(); });
  toTime(a + 1e-6);
  queued(() => { $("said").textContent = `beat ${i + 1} is doubtful: ${why}`; count("doubted"); });
}
// the frame that images and scene show
const timeOf = c => { const i = c.frames.findIndex(f => f >= frame); return c.seconds[i < 0 ? c.seconds.length - 1 : i]; };
function now(u) {
  const x = u.valToPos(timeOf(curves[plotted[0]]), "x", true), g = u.ctx, box = u.bbox;
  if (x < box.left || x > box.left + box.width) return;
  g.save(); g.strokeStyle = color("--bad"); g.lineWidth = 2 * devicePixelRatio; g.beginPath(); g.moveTo(x, box.top); g.lineTo(x, box.top + box.height); g.stroke(); g.restore();
}
function toTime(seconds) {
  const c = curves[plotted[0]];
  let best = 0;
  c.seconds.forEach((s, i) => { if (Math.abs(s - seconds) < Math.abs(c.seconds[best] - seconds)) best = i; });
  queued(async () => { await show(c.frames[best]); atFrame(); count("pointed"); });
}
// what follows the frame in this room
function atFrame() {
  $("moment").textContent = `frame ${frame + 1}`;
  charts.forEach(c => c.redraw(false)); place3();
}
async function potential(joint) {
  $("map").classList.toggle("now", Boolean(joint)); way = null;
  if (joint) {
    $("potential").src = "potential?name=" + encodeURIComponent(joint) + ofTrial(); $("potential").alt = `potential of ${joint}`;
    way = await get("way?name=" + encodeURIComponent(joint) + ofTrial());
    $("joint-name").textContent = `${way.name}: yellow where it was held, violet where it never was; red: now`;
    await $("potential").decode(); place3(); count("mapped");
  }
  if (shownQuantities.length) await plot();
}
// where the joint is now, over its map
function place3() {
  const k = $("place"), g = k.getContext("2d"); k.width = k.clientWidth; k.height = k.clientHeight;
  const to = way && way.places[frame];
  if (!to) return;
  const at = p => [p[0] * k.width, p[1] * k.height];
  g.strokeStyle = g.fillStyle = "#f05a28"; g.lineWidth = 4; g.beginPath(); g.moveTo(...at(way.centre)); g.lineTo(...at(to)); g.stroke();
  g.beginPath(); g.arc(...at(to), 7, 0, 7); g.fill();
}
$("quantity").oninput = $("accelerations").onchange = choices;
function doubtable(c) {
  const n = c ? Object.keys(c.doubtful[$("cycle").value] || {}).length : 0;
  $("doubt").disabled = !n; $("doubt").textContent = n ? `Next doubtful beat (d), of ${n}` : "No doubtful beat";
}
$("cycle").onchange = () => { doubtable(curves[plotted[0]]); charts.forEach(c => c.redraw()); };
$("doubt").onclick = doubt;
$("joint").onchange = e => queued(() => potential(e.target.value));
$("all").onclick = () => { extent = null; queued(plot); };
$("images").onclick = () => room("proof");
