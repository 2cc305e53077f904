/* Stations, beams, points and tools of a campaign. Places in mm. */
function campaignScene(root, data) {
  const { colours, words } = data;
  const form = root.querySelector("form");
  const SYMBOLS = ["circle", "x", "square", "cross", "diamond"];

  const columns = (flat) => {
    const values = Array.from(Scenes.unpacked(flat));
    return [0, 1, 2].map((c) => values.filter((_, i) => i % 3 === c));
  };
  const trace = (flat, more) => { const [x, y, z] = columns(flat); return { type: "scatter3d", x, y, z, ...more }; };

  const corners = columns(data.box);
  const EDGES = [[0, 1, 3, 2, 0], [4, 5, 7, 6, 4], [0, 4], [1, 5], [2, 6], [3, 7]];
  const box = { type: "scatter3d", mode: "lines", ...Scenes.joined(EDGES, ...corners), line: { color: colours.neutral, width: 2 }, name: words.box, hoverinfo: "skip" };

  function beams() {
    const out = { x: [], y: [], z: [] };
    for (const beam of data.beams) {
      const [x, y, z] = columns(beam.to);
      x.forEach((_, i) => {
        out.x.push(beam.from[0], x[i], null); out.y.push(beam.from[1], y[i], null); out.z.push(beam.from[2], z[i], null);
      });
    }
    return { type: "scatter3d", mode: "lines", ...out, line: { color: colours.faint, width: 1 }, name: words.beams, hoverinfo: "skip" };
  }

  function lines(list, more) {
    const out = { x: [], y: [], z: [] };
    for (const flat of list) {
      const [x, y, z] = columns(flat);
      out.x.push(...x, null); out.y.push(...y, null); out.z.push(...z, null);
    }
    return { type: "scatter3d", mode: "lines", ...out, hoverinfo: "skip", ...more };
  }

  const stands = (list, symbol, name) => ({
    type: "scatter3d", mode: "markers+text", x: list.map((s) => s.place[0]), y: list.map((s) => s.place[1]), z: list.map((s) => s.place[2]),
    text: list.map((s) => s.name), textposition: "top center", textfont: { size: 12 }, hovertext: list.map((s) => s.words), hoverinfo: "text",
    marker: { symbol, size: 6, color: colours.ink }, name,
  });

  const bySet = (i) => ({ size: 1.6, color: colours.series[i % colours.series.length], symbol: SYMBOLS[i % SYMBOLS.length], showscale: false });
  const bySize = (canvas, values, i, last) => ({
    size: 1.8, color: values, colorscale: colours.sizes, cmin: 0, cmax: data.most, symbol: SYMBOLS[i % SYMBOLS.length], showscale: last,
    colorbar: Scenes.bar(canvas, words.normalised),
  });

  return async (Plotly, canvas) => {
    const sizes = data.points.map((p) => Array.from(Scenes.unpacked(p.normalised)));
    const points = data.points.map((p, i) => trace(p.places, {
      mode: "markers", name: p.name, marker: bySet(i), hoverinfo: "text",
      text: sizes[i].map((v) => `${p.name}<br>${words.normalised}: ${Number.isFinite(v) ? Scenes.written(v, 2) : "–"}`),
    }));
    const traces = [box, ...points];
    if (data.beams.length) traces.push(beams());
    if (data.lines.length) traces.push(lines(data.lines, { name: words.lines, line: { color: colours.neutral, width: 2 } }));
    if (data.tools.length) traces.push(lines(data.tools, { name: words.tools, line: { color: colours.ink, width: 7 } }));
    if (data.stations.length) traces.push(stands(data.stations, "diamond", words.stations));
    if (data.spheres.length) traces.push(stands(data.spheres, "circle-open", words.spheres));
    const layout = Scenes.layout(canvas, data.ranges, data.axes, colours);
    layout.showlegend = true;
    layout.legend = { orientation: "h", x: 0, y: 0, yanchor: "top", font: { size: 12 }, itemsizing: "constant" };
    layout.margin = { l: 0, r: 0, t: 0, b: 8 };
    await Plotly.newPlot(canvas, traces, layout, Scenes.CONFIG);
    Scenes.views(root, Plotly, canvas, () => data.ranges);
    form.addEventListener("submit", (event) => event.preventDefault());
    form.addEventListener("change", () => {
      const own = form.elements.colour.value === "size";
      const numbers = points.map((_, i) => 1 + i);
      const markers = points.map((_, i) => (own ? bySize(canvas, sizes[i].map((v) => (Number.isFinite(v) ? v : null)), i, i === 0) : bySet(i)));
      Plotly.restyle(canvas, { marker: markers }, numbers);
    });
  };
}
