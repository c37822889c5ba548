// Replaces each still picture by a live one. Without scripts, or without DecompressionStream, the stills stay.
(async () => {
  if (!("DecompressionStream" in window)) return;
  const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const source = await new Response(stream).text();
  const script = document.createElement("script");
  script.textContent = source;
  document.head.appendChild(script);
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const narrow = () => window.innerWidth < 640;
  for (const figure of document.querySelectorAll("figure[data-chart]")) {
    const { data, layout, beside } = figures[figure.dataset.chart];
    const live = figure.querySelector(".live");
    figure.classList.add("drawn");
    if (narrow()) shrink(data, layout, beside);
    await Plotly.newPlot(live, data, layout, {
      responsive: true, displaylogo: false, displayModeBar: narrow() ? false : "hover",
      modeBarButtonsToRemove: ["select2d", "lasso2d", "zoomIn2d", "zoomOut2d"],
    });
  }
  document.documentElement.dataset.ready = "yes";

  // A long name over several lines of about sixteen characters.
  function broken(name) {
    const lines = [""];
    for (const word of name.split(" ")) {
      const last = lines.length - 1;
      if (lines[last] && lines[last].length + word.length > 15) lines.push(word);
      else lines[last] = `${lines[last]} ${word}`.trim();
    }
    return lines.join("<br>");
  }

  // On a phone, panels that stood side by side stand under one another.
  function shrink(data, layout, beside) {
    layout.font.size = 11;
    layout.margin = { ...layout.margin, l: 44, r: 4 };
    layout.dragmode = false;
    for (const key of Object.keys(layout).filter((name) => name.startsWith("yaxis"))) {
      const rows = layout[key].categoryarray;
      if (rows) Object.assign(layout[key], { tickvals: rows, ticktext: rows.map(broken), tickfont: { size: 9 } });
    }
    if (!beside) return;
    const axes = Object.keys(layout).filter((key) => key.startsWith("xaxis"));
    const gap = 130 / (layout.height * axes.length), size = (1 - gap * (axes.length - 1)) / axes.length;
    layout.height = layout.height * axes.length;
    axes.forEach((key, i) => {
      const top = 1 - i * (size + gap);
      const y = layout[key.replace("x", "y")];
      layout[key].domain = [0, 1];
      y.domain = [Math.max(top - size, 0), top];
      y.showticklabels = true;
    });
    for (const { colorbar, yaxis } of data.filter((trace) => trace.colorbar)) {
      const below = layout[yaxis.replace("y", "yaxis")].domain[0] - 54 / layout.height;
      Object.assign(colorbar, { x: 0.5, len: 1, y: below });
    }
  }
})();
