// a marker about the frame that is shown: as it was tracked, as corrections have it, and what was not measured filled as by hand
let traces = [];
const TRACED = [["before", "tracked", [5, 4], 1.5], ["after", "corrected", undefined, 2], ["spline", "spline", [2, 3], 1.5], ["neighbours", "neighbours", [6, 2, 2, 2], 2]];
async function trace() {
  if (!$("trace").classList.contains("now") || !info || info.digitise) return;
  const c = await get(`around?frame=${frame}&marker=${marker}${ofTrial()}`);
  traces.forEach(t => t.destroy());
  const axis = { stroke: color("--text"), grid: { stroke: color("--line"), width: 1 }, ticks: { stroke: color("--line") }, font: "12px system-ui" };
  const inks = [color("--quiet"), color("--mid"), color("--right"), color("--left")], wide = $("trace").clientWidth / 3 - 6;
  $("trace").replaceChildren(make("p", "Neighbours: " + c.said, { className: "quiet" }));
  traces = [0, 1, 2].map(k => new uPlot({
    title: `${info.names[marker]} ${"xyz"[k]} (mm)`, width: wide, height: 190, legend: { show: true, live: false }, scales: { x: { time: false } },
    series: [{}, ...TRACED.map(([, label, dash, width], i) => ({ label, dash, width, stroke: inks[i], points: { show: false } }))],
    axes: [{ ...axis, size: 28 }, { ...axis, size: 56 }],
    hooks: { draw: [u => {
      const x = u.valToPos(frame + 1, "x", true), g = u.ctx, box = u.bbox;
      g.save(); g.setLineDash([]); g.strokeStyle = color("--bad"); g.lineWidth = 2 * devicePixelRatio; g.beginPath(); g.moveTo(x, box.top); g.lineTo(x, box.top + box.height); g.stroke(); g.restore();
    }], ready: [u => { u.over.onclick = e => queued(() => show(Math.round(u.posToVal(e.offsetX, "x")) - 1)); }] },
  }, [c.frames.map(f => f + 1), ...TRACED.map(([of]) => c[of][k])], $("trace")));
  document.body.dataset.traced = `${frame} ${marker}`;
}
async function toggleTrace() {
  const now = $("trace").classList.toggle("now");
  $("curves").classList.toggle("now", now); $("curves").setAttribute("aria-pressed", now);
  if (now) await trace();
  if (shown) draw();
}
$("curves").onclick = () => queued(toggleTrace);
