/* The deviation field on the deformed lattice. Deviations in µm, places in mm. */
function deviationField(root, data) {
  const [nx, ny, nz] = data.nodes.map((n) => n.length);
  const count = nx * ny * nz;
  const [, places, states] = data.counts;
  const number = (i, j, k) => (i * ny + j) * nz + k;
  const at = [[], [], []];
  const rows = [];
  const range = (n) => Array.from({ length: n }, (_, i) => i);
  for (const i of range(nx)) for (const j of range(ny)) for (const k of range(nz)) {
    at[0].push(data.nodes[0][i]); at[1].push(data.nodes[1][j]); at[2].push(data.nodes[2][k]);
  }
  if (nx > 1) for (const j of range(ny)) for (const k of range(nz)) rows.push(range(nx).map((i) => number(i, j, k)));
  if (ny > 1) for (const i of range(nx)) for (const k of range(nz)) rows.push(range(ny).map((j) => number(i, j, k)));
  if (nz > 1) for (const i of range(nx)) for (const j of range(ny)) rows.push(range(nz).map((k) => number(i, j, k)));

  /* Factors 1, 1.5, 2, 3, 5, 7, from a fiftieth of the first one to a thousand times it. */
  const factors = [0, 1, 2, 3, 4, 5, 6, 7, 8].flatMap((power) => [1, 1.5, 2, 3, 5, 7].map((f) => f * 10 ** power));
  const kept = factors.filter((f) => f >= data.factor / 50 && f <= data.factor * 1000);

  const form = root.querySelector("form");
  const { state, tool, place, magnification, factor, arrows, own, rigid } = form.elements;
  magnification.max = kept.length - 1;
  magnification.defaultValue = kept.indexOf(data.factor);
  magnification.value = magnification.defaultValue;

  const cache = new Map();
  const unpacked = (kind, index) => {
    const key = `${kind} ${index}`;
    if (!cache.has(key)) cache.set(key, Scenes.unpacked(data[kind][index]));
    return cache.get(key);
  };

  const fieldNumber = (n = Number(state.value)) => ((Number(tool.value) || 0) * places + (Number(place?.value) || 0)) * states + n;

  /* A field with its lengths, less the rigid motion where that is asked for. */
  function field(index) {
    const given = unpacked("fields", index), m = data.motions[index];
    const values = [0, 1, 2].map((c) => Float32Array.from({ length: count }, (_, i) => {
      const v = given[3 * i + c];
      return rigid.checked ? v - (m[4 * c] * at[0][i] + m[4 * c + 1] * at[1][i] + m[4 * c + 2] * at[2][i] + m[4 * c + 3]) : v;
    }));
    const length = Float32Array.from({ length: count }, (_, i) => Math.hypot(values[0][i], values[1][i], values[2][i]));
    return { values, length, largest: length.reduce((most, v) => (v > most ? v : most), 0) };
  }

  /* One colour scale for all that is compared: the largest of any tool vector and rotary position before compensation. */
  const limit = { true: 0, false: 0 };
  function common() {
    const key = String(rigid.checked);
    if (!limit[key]) {
      for (let first = 0; first < data.fields.length; first += states) limit[key] = Math.max(limit[key], field(first).largest);
    }
    return limit[key] || 1;
  }

  const digits = (v) => (v >= 1 ? 1 : v >= 0.1 ? 2 : 3);
  const placeOf = (i) => ["X", "Y", "Z"].map((a, c) => Scenes.said(data.words.place_here, { name: a, value: Scenes.place(at[c][i]) })).join(", ");

  /* Deviations of a node along X, Y, Z with U, which holds in the stated datum only. */
  function components(now, i, joint) {
    const u = unpacked("u", Math.floor(fieldNumber(0) / states));
    return ["X", "Y", "Z"].map((a, c) => {
      const value = `${a} ${Scenes.written(now.values[c][i], 2)}`;
      return rigid.checked ? value : `${value} ± ${Scenes.written(u[3 * i + c], 2)}`;
    }).join(joint);
  }

  function tell(now) {
    const line = root.querySelector(".scene-state");
    const name = data.states[Number(state.value)];
    const worst = now.length.indexOf(now.largest);
    if (worst < 0 || !now.length.some((v) => v >= 0)) { line.textContent = `${name}: ${data.words.nowhere}`; return; }
    const size = Scenes.written(now.largest, digits(now.largest));
    const unit = rigid.checked ? "µm" : `µm; ${data.words.with_u}`;
    line.textContent = `${Scenes.said(data.words.state_place, { state: name, size, place: placeOf(worst) })} (${components(now, worst, ", ")} ${unit}).`;
  }

  const moved = (now, scale) => [0, 1, 2].map((c) => Array.from({ length: count }, (_, i) => {
    const v = at[c][i] + scale * now.values[c][i] / 1000;
    return Number.isFinite(v) ? v : null;
  }));

  /* A shaft from every node to where it went, and four barbs, longer for longer arrows. */
  function arrowLines(there) {
    const out = { x: [], y: [], z: [] };
    const push = (...points) => {
      for (const [x, y, z] of points) { out.x.push(x); out.y.push(y); out.z.push(z); }
      out.x.push(null); out.y.push(null); out.z.push(null);
    };
    for (let i = 0; i < count; i++) {
      const from = at.map((a) => a[i]), to = there.map((a) => a[i]);
      const along = to.map((v, c) => v - from[c]), size = Math.hypot(...along);
      if (to[0] === null || size < data.spacing / 200) continue;
      const unit = along.map((v) => v / size);
      const other = Math.abs(unit[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
      const side = cross(unit, other), norm = Math.hypot(...side), a = side.map((v) => v / norm), b = cross(unit, a);
      const back = Math.min(0.4 * size, 0.15 * data.spacing), tip = (d, s) => to.map((v, c) => v - back * unit[c] + s * 0.45 * back * d[c]);
      push(from, to);
      push(tip(a, 1), to, tip(a, -1));
      push(tip(b, 1), to, tip(b, -1));
    }
    return out;
  }
  const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];

  const coloured = (now) => rows.flatMap((row) => [...row.map((i) => now.length[i] || 0), 0]);
  const hovers = (now) => Array.from({ length: count }, (_, i) =>
    `${placeOf(i)} mm<br>${data.words.node} ${Scenes.written(now.length[i], 2)} µm<br>${components(now, i, "<br>")} µm`);

  /* The ranges of the axes: room for the first factor, more where a larger one needs it. */
  function ranges(now, scale) {
    const known = Number.isFinite(now.largest) ? now.largest : 0;
    const room = Math.max(1.2 * data.factor * common() / 1000, 1.05 * scale * known / 1000, data.spacing / 4);
    return data.nodes.map((n) => [n[0] - room, n[n.length - 1] + room]);
  }

  return async (Plotly, canvas) => {
    const { colours, words } = data;
    const chosen = () => kept[Number(magnification.value)];
    let now = field(fieldNumber()), limits = ranges(now, chosen());
    const top = () => (own.checked ? now.largest || 1 : common());
    const colour = () => ({ colorscale: colours.sizes, cmin: 0, cmax: top() });
    const there = moved(now, chosen());
    const box = Scenes.joined(rows, ...at), bent = Scenes.joined(rows, ...there), shafts = arrowLines(there);
    const traces = [
      { type: "scatter3d", mode: "lines", ...box, line: { color: colours.faint, width: 1 }, hoverinfo: "skip" },
      { type: "scatter3d", mode: "lines", ...bent, line: { color: coloured(now), width: 3, ...colour() }, hoverinfo: "skip" },
      { type: "scatter3d", mode: "lines", ...shafts, line: { color: colours.ink, width: 2.5 }, hoverinfo: "skip", visible: arrows.checked },
      { type: "scatter3d", mode: "markers", x: there[0], y: there[1], z: there[2], text: hovers(now), hoverinfo: "text",
        marker: { size: 2, color: Array.from(now.length), showscale: true, colorbar: Scenes.bar(canvas, words.length), ...colour() } },
    ];
    await Plotly.newPlot(canvas, traces, Scenes.layout(canvas, limits, data.axes, colours), Scenes.CONFIG);
    const zoom = Scenes.views(root, Plotly, canvas, () => limits);

    function show(recoloured) {
      const places3 = moved(now, chosen());
      const lines = Scenes.joined(rows, ...places3), heads = arrowLines(places3);
      const change = { x: [lines.x, heads.x, places3[0]], y: [lines.y, heads.y, places3[1]], z: [lines.z, heads.z, places3[2]] };
      const layout = {};
      const wanted = ranges(now, chosen());
      if (JSON.stringify(wanted) !== JSON.stringify(limits)) {
        limits = wanted;
        ["xaxis", "yaxis", "zaxis"].forEach((name, c) => { layout[`scene.${name}.range`] = limits[c]; });
        layout["scene.aspectratio"] = Scenes.ratio(canvas, limits, zoom());
        layout["scene.annotations"] = Scenes.names(limits, data.axes);
      }
      if (recoloured) {
        change["line.color"] = [coloured(now), colours.ink, undefined];
        change["line.cmax"] = [top(), undefined, undefined];
        change["marker.color"] = [undefined, undefined, Array.from(now.length)];
        change["marker.cmax"] = [undefined, undefined, top()];
        change.text = [undefined, undefined, hovers(now)];
        change.visible = [true, arrows.checked, true];
      }
      factor.textContent = `${words.deviations} ${Scenes.written(chosen(), chosen() < 10 ? 1 : 0)}`;
      magnification.setAttribute("aria-valuetext", factor.textContent);
      return Plotly.update(canvas, change, layout, [1, 2, 3]);
    }
    const change = () => { now = field(fieldNumber()); tell(now); return show(true); };

    let waiting = false, working = 0, busy = Promise.resolve();
    const then = (work) => {
      canvas.setAttribute("aria-busy", "true");
      working += 1;
      busy = busy.then(work).then(() => { working -= 1; if (!working) canvas.setAttribute("aria-busy", "false"); });
    };
    magnification.addEventListener("input", () => {
      factor.textContent = `${words.deviations} ${Scenes.written(chosen())}`;
      if (waiting) return;
      waiting = true;
      then(() => new Promise(requestAnimationFrame).then(() => { waiting = false; return show(false); }));
    });
    form.addEventListener("change", (event) => { if (event.target !== magnification) then(change); });
    form.addEventListener("submit", (event) => event.preventDefault());
    await change();
  };
}
