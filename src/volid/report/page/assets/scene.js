"use strict";
/* Drawings in 3-D: the library is unpacked when the first of them comes near the view. */
const Scenes = (() => {
  const VIEWS = { oblique: [1.02, -1.63, 0.86], X: [2.1, 0, 0], Y: [0, -2.1, 0], Z: [0, -0.001, 2.1] };
  const FONT = '"DejaVu Sans", Verdana, sans-serif';
  const LANGUAGE = document.documentElement.lang;
  let library = null;

  async function unpack() {
    const packed = atob(document.getElementById("library").textContent.trim());
    const bytes = Uint8Array.from(packed, (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
    return window.Plotly;
  }

  function canDraw() {
    if (!document.getElementById("library") || !window.DecompressionStream || !window.IntersectionObserver) return false;
    const context = document.createElement("canvas").getContext("webgl");
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return Boolean(context);
  }

  /* 16-bit numbers in base64 as floating-point ones, NaN where there is none. */
  function unpacked({ scale, data }) {
    const bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
    return Float32Array.from(new Int16Array(bytes.buffer), (v) => (v === -32768 ? NaN : v * scale));
  }

  function written(value, digits = 0) {
    return value.toLocaleString(LANGUAGE, { minimumFractionDigits: digits, maximumFractionDigits: digits }).replace("-", "−");
  }

  /* A place in mm, without separators that stand for thousands. */
  function place(value) {
    return value.toLocaleString(LANGUAGE, { maximumFractionDigits: 1, useGrouping: false }).replace("-", "−");
  }

  function said(words, values) {
    return words.replace(/\{(\w+)\}/g, (_, name) => values[name]);
  }

  function layout(canvas, ranges, titles, colours) {
    const axis = (k) => ({
      title: { text: "" }, range: ranges[k], tickfont: { size: 12 }, nticks: 6, color: colours.ink,
      gridcolor: colours.faint, zerolinecolor: colours.faint, linecolor: colours.neutral, showspikes: false, exponentformat: "none",
      separatethousands: false,
    });
    return {
      scene: {
        xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual", aspectratio: ratio(canvas, ranges, 1),
        camera: camera("oblique"), dragmode: "orbit", domain: { x: [0, 1], y: [isNarrow(canvas) ? 0.13 : 0, 1] }, annotations: names(ranges, titles),
      },
      font: { family: FONT, size: 12, color: colours.ink }, margin: { l: 0, r: 0, t: 0, b: isNarrow(canvas) ? 8 : 0 }, showlegend: false,
      separators: LANGUAGE === "de" ? ",." : ".,", paper_bgcolor: "transparent", hoverlabel: { align: "left" },
    };
  }

  function camera(view) {
    const [x, y, z] = VIEWS[view];
    const up = view === "Z" ? { x: 0, y: 1, z: 0 } : { x: 0, y: 0, z: 1 };
    return { eye: { x, y, z }, up, center: { x: 0, y: 0, z: 0 }, projection: { type: "orthographic" } };
  }

  /* The names of the axes at their far ends, just within the ranges: beyond them nothing is written. */
  function names(ranges, titles) {
    const [x, y, z] = ranges.map(([low, high]) => [low + 1e-4 * (high - low), high - 1e-4 * (high - low)]);
    const ends = [[x[1], y[0], z[0]], [x[1], y[1], z[0]], [x[0], y[0], z[1]]];
    const shifts = [[10, -22], [34, 10], [0, 14]];
    return titles.map((text, k) => ({
      text: `<b>${text}</b>`, x: ends[k][0], y: ends[k][1], z: ends[k][2], xshift: shifts[k][0], yshift: shifts[k][1], showarrow: false,
      font: { size: 12 },
    }));
  }

  /* Sides of the drawn box, one scale for all axes: as large as the canvas has room for in the first view, names beside it.
     A side of 2 is as long as the canvas is high; seen from X, Y and Z the box fits too. */
  function ratio(canvas, ranges, zoom) {
    const [x, y, z] = ranges.map(([low, high]) => high - low);
    const room = canvas.clientWidth - (isNarrow(canvas) ? 120 : 260), high = canvas.clientHeight * (isNarrow(canvas) ? 0.87 : 1);
    const fit = Math.min(1.7 / (0.22 * x + 0.35 * y + 0.91 * z), (2 * room) / high / (0.85 * x + 0.53 * y), 1.8 / Math.max(y, z));
    return { x: zoom * fit * x, y: zoom * fit * y, z: zoom * fit * z };
  }

  /* Lines through places: `rows` of numbers of nodes, with gaps between them. */
  function joined(rows, x, y, z) {
    const out = { x: [], y: [], z: [] };
    for (const row of rows) {
      for (const i of row) { out.x.push(x[i]); out.y.push(y[i]); out.z.push(z[i]); }
      out.x.push(null); out.y.push(null); out.z.push(null);
    }
    return out;
  }

  /* Make a drawing ready: `draw(Plotly, canvas)` is called once, when it comes near the view or its button is pressed. */
  function mount(root, draw) {
    const part = (name) => root.querySelector(`.scene-${name}`);
    if (!canDraw()) { part("none").hidden = false; return; }
    const button = part("start");
    let started = false;
    const start = async () => {
      if (started) return;
      started = true;
      watcher.disconnect();
      button.disabled = true;
      root.dataset.state = "drawing";
      try {
        library ??= unpack();
        const Plotly = await library;
        part("canvas").hidden = false;
        part("controls").hidden = false;
        await draw(Plotly, part("canvas"));
        button.hidden = true;
        root.dataset.state = "drawn";
      } catch (problem) {
        part("canvas").hidden = true;
        part("controls").hidden = true;
        part("none").hidden = false;
        button.hidden = true;
        root.dataset.state = "failed";
        console.error(problem);
      }
    };
    button.hidden = false;
    button.addEventListener("click", start);
    const watcher = new IntersectionObserver((seen) => { if (seen.some((e) => e.isIntersecting)) start(); }, { rootMargin: "150px" });
    watcher.observe(root);
  }

  /* On a phone a drawing is as wide as it is high: names and numbers of the axes need more of it, and the scale lies below. */
  const isNarrow = (canvas) => canvas.clientWidth < 600;
  const bar = (canvas, words) => ({
    title: { text: words, side: isNarrow(canvas) ? "top" : "right", font: { size: 12 } }, thickness: 14, tickfont: { size: 12 }, outlinewidth: 0,
    ...(isNarrow(canvas) ? { orientation: "h", x: 0.5, len: 0.9, y: 0, yanchor: "bottom", ypad: 0 } : { x: 1, len: 0.8, xpad: 4 }),
  });

  /* Buttons for views and distance. */
  function views(root, Plotly, canvas, ranges) {
    let zoom = 1;
    for (const button of root.querySelectorAll("[data-view]")) {
      button.addEventListener("click", () => Plotly.relayout(canvas, { "scene.camera": camera(button.dataset.view) }));
    }
    for (const button of root.querySelectorAll("[data-zoom]")) {
      button.addEventListener("click", () => {
        zoom = Math.min(8, Math.max(0.3, zoom * Number(button.dataset.zoom)));
        Plotly.relayout(canvas, { "scene.aspectratio": ratio(canvas, ranges(), zoom) });
      });
    }
    return () => zoom;
  }

  const CONFIG = { displayModeBar: false, responsive: true, scrollZoom: false, doubleClick: false, showTips: false, staticPlot: false };
  return { CONFIG, bar, camera, joined, layout, mount, names, place, ratio, said, unpacked, views, written };
})();
