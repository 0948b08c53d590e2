"use strict";
(() => {
  const data = JSON.parse(document.getElementById("frames").textContent);
  const at = (id) => document.getElementById(id);
  const slider = at("frame"), play = at("play"), choice = at("run"), view = at("view"), curve = at("curve");
  const pen = view.getContext("2d"), ink = curve.getContext("2d");
  const images = new Map();
  let timer = null;
  view.width = data.width; view.height = data.height;
  slider.max = data.frames.length - 1;

  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const image = (i) => {
    if (!images.has(i)) {
      const picture = new Image();
      picture.onload = () => { if (Number(slider.value) === i) show(); };
      picture.src = data.folder + String(data.frames[i]).padStart(6, "0") + ".jpg";
      images.set(i, picture);
    }
    return images.get(i);
  };
  const lines = (segments, colour, width) => {
    pen.strokeStyle = colour; pen.lineWidth = width; pen.lineCap = "round"; pen.beginPath();
    for (let k = 0; k < segments.length; k += 4) {
      pen.moveTo(segments[k] + .5, segments[k + 1] + .5); pen.lineTo(segments[k + 2] + .5, segments[k + 3] + .5);
    }
    pen.stroke();
  };
  const number = (value, digits, unit) => value === null ? "no pose" : value.toFixed(digits) + " " + unit;

  const LOW = .1, HIGH = 200, LEFT = 46 * devicePixelRatio, BOTTOM = 22 * devicePixelRatio, TOP = 8;
  const x = (i) => LEFT + (curve.width - LEFT - 8) * i / Math.max(1, data.frames.length - 1);
  const y = (cm) => TOP + (curve.height - TOP - BOTTOM) * (1 - Math.log(Math.min(HIGH, Math.max(LOW, cm)) / LOW) / Math.log(HIGH / LOW));
  const drawCurve = (i, run) => {
    curve.width = curve.clientWidth * devicePixelRatio; curve.height = 190 * devicePixelRatio;
    ink.font = 11 * devicePixelRatio + "px system-ui, sans-serif";
    ink.fillStyle = style("--soft"); ink.strokeStyle = style("--line"); ink.lineWidth = devicePixelRatio;
    for (const cm of [.1, 1, 10, 100]) {
      ink.beginPath(); ink.moveTo(LEFT, y(cm)); ink.lineTo(curve.width - 8, y(cm)); ink.stroke();
      ink.textAlign = "right"; ink.fillText(cm + (cm === 100 ? " cm" : ""), LEFT - 5, y(cm) + 4 * devicePixelRatio);
    }
    ink.setLineDash([3, 3]); ink.strokeStyle = style("--bad"); ink.beginPath(); ink.moveTo(LEFT, y(5)); ink.lineTo(curve.width - 8, y(5)); ink.stroke(); ink.setLineDash([]);
    data.runs.forEach((other, k) => {
      ink.strokeStyle = other.colour; ink.globalAlpha = k === run ? 1 : .3; ink.lineWidth = (k === run ? 2 : 1) * devicePixelRatio;
      ink.beginPath(); let down = false;
      other.cm.forEach((cm, j) => { if (cm === null) { down = false; return; } down ? ink.lineTo(x(j), y(cm)) : ink.moveTo(x(j), y(cm)); down = true; });
      ink.stroke();
    });
    ink.globalAlpha = .18; ink.fillStyle = style("--bad");
    const good = data.runs[run].success, last = good.length - 1;
    for (let j = 0; j <= last; j++) {
      if (good[j]) continue;
      const begin = j;
      while (j < last && !good[j + 1]) j++;
      const left = x(Math.max(0, begin - .5));
      ink.fillRect(left, TOP, x(Math.min(last, j + .5)) - left, curve.height - TOP - BOTTOM);
    }
    ink.globalAlpha = 1; ink.strokeStyle = style("--ink"); ink.lineWidth = 1.5 * devicePixelRatio;
    ink.beginPath(); ink.moveTo(x(i), TOP); ink.lineTo(x(i), curve.height - BOTTOM); ink.stroke();
    ink.fillStyle = style("--soft"); ink.textAlign = "center";
    ink.fillText("time (s): " + data.seconds[i].toFixed(2), Math.min(curve.width - 60, Math.max(LEFT + 50, x(i))), curve.height - 6);
  };
  const show = () => {
    const i = Number(slider.value), run = Number(choice.value), now = data.runs[run];
    const picture = image(i);
    if (picture.complete && picture.naturalWidth) pen.drawImage(picture, 0, 0, view.width, view.height);
    else { pen.fillStyle = "#111"; pen.fillRect(0, 0, view.width, view.height); }
    lines(data.ground_truth[i], "rgba(255,255,255,.85)", 1.2);
    lines(now.edges[i], "#3cdc46", 2.2);
    at("shown").textContent = data.frames[i];
    at("seconds").textContent = data.seconds[i].toFixed(2) + " s";
    at("position").textContent = number(now.cm[i], 2, "cm");
    at("rotation").textContent = number(now.deg[i], 2, "\u00b0");
    at("state").textContent = now.success[i] ? "within 5 cm and 5\u00b0" : now.cm[i] === null ? "lost: no pose" : "off target: outside 5 cm and 5\u00b0";
    at("estimated").textContent = now.since[i] === null ? "\u2014" : now.since[i] === 0 ? "this frame" : now.since[i] + " frames ago";
    drawCurve(i, run);
    for (const ahead of [1, 2, 3]) if (i + ahead < data.frames.length) image(i + ahead);
    history.replaceState(null, "", "#run=" + run + "&frame=" + data.frames[i]);
  };
  const go = (i) => { slider.value = Math.max(0, Math.min(data.frames.length - 1, i)); show(); };
  const stop = () => { clearInterval(timer); timer = null; play.textContent = "Play"; };
  slider.addEventListener("input", show);
  choice.addEventListener("change", show);
  play.addEventListener("click", () => {
    if (timer) return stop();
    play.textContent = "Pause";
    timer = setInterval(() => Number(slider.value) >= data.frames.length - 1 ? go(0) : go(Number(slider.value) + 1), data.step_ms);
  });
  curve.addEventListener("click", (event) => {
    const box = curve.getBoundingClientRect(), place = (event.clientX - box.left) * curve.width / box.width;
    go(Math.round((place - LEFT) / (curve.width - LEFT - 8) * (data.frames.length - 1)));
  });
  document.addEventListener("keydown", (event) => {
    if (event.target.matches("input, select")) return;
    if (event.key === "ArrowRight") go(Number(slider.value) + 1);
    if (event.key === "ArrowLeft") go(Number(slider.value) - 1);
  });
  addEventListener("resize", show);
  const wanted = new URLSearchParams(location.hash.slice(1));
  if (wanted.has("run")) choice.value = wanted.get("run");
  const target = Number(wanted.get("frame") || 0);
  const nearest = data.frames.findIndex((frame) => frame >= target);
  go(nearest < 0 ? 0 : nearest);
})();
