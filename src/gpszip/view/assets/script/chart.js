/**
 * The chart under the map: series over time, with a cursor and a range.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./series.js").Series} Series
 *
 * @typedef {object} Plot Where the chart draws.
 * @property {HTMLCanvasElement} canvas
 * @property {HTMLCanvasElement} overlay
 * @property {number} width CSS pixels
 * @property {number} height
 * @property {number} ratio
 */

import { clockEpoch } from "./clock.js";
import { UNITS, formatLength, formatNumber, lengthUnit, niceStep } from "./format.js";
import { THEMES } from "./colours.js";
import { chartKinds, chartSeries } from "./series.js";
import { formatTime, timeTicks } from "./times.js";
import { lastAtMost } from "./walks.js";

/** CSS pixels around the plot. */
const CHART_MARGIN = { left: 52, right: 14, top: 10, bottom: 22 };

/** Values of a series that are drawn one by one at most; of more, the extremes of each pixel. */
const MAX_SINGLE = 5000;

/** Share of the time whose speeds fit into the chart, and by how much more: the rest is noise. */
const SHOWN_SHARE = 0.995;
const SHOWN_FACTOR = 1.5;

/** Opacity of samples behind the walks. */
const RAW_OPACITY = 0.55;

/** CSS pixels between ticks of the time axis, and between values, about. */
const TICK_PIXELS = 110;
const VALUE_PIXELS = 34;

/**
 * Horizontal place of a time.
 * @param {Plot} plot
 * @param {[number, number]} domain
 * @param {number} time
 */
function timeToX(plot, domain, time) {
  const inner = plot.width - CHART_MARGIN.left - CHART_MARGIN.right;
  return CHART_MARGIN.left + ((time - domain[0]) / (domain[1] - domain[0])) * inner;
}

/**
 * Time of a horizontal place.
 * @param {Plot} plot
 * @param {[number, number]} domain
 * @param {number} x CSS pixels
 */
export function xToTime(plot, domain, x) {
  const inner = plot.width - CHART_MARGIN.left - CHART_MARGIN.right;
  return domain[0] + ((x - CHART_MARGIN.left) / inner) * (domain[1] - domain[0]);
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {number} ratio
 */
function chartContext(canvas, ratio) {
  const ctx = /** @type {CanvasRenderingContext2D} */ (
    canvas.getContext("2d", { willReadFrequently: true })
  );
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  return ctx;
}

/**
 * Draw the chart.
 * @param {App} app
 * @param {Plot} plot
 */
export function drawChart(app, plot) {
  const { domain, chart, theme } = app.store.state;
  const ctx = chartContext(plot.canvas, plot.ratio);
  ctx.fillStyle = THEMES[theme].paper;
  ctx.fillRect(0, 0, plot.width, plot.height);

  // Axes, then what they measure.
  const series = chartSeries(app);
  const range = verticalRange(series, domain, chart);
  const bottom = plot.height - CHART_MARGIN.bottom;
  const toY = (/** @type {number} */ value) =>
    bottom - ((value - range[0]) / (range[1] - range[0])) * (bottom - CHART_MARGIN.top);
  drawValueAxis(app, plot, ctx, range, toY);
  drawTimeAxis(app, plot, ctx);
  ctx.save();
  ctx.beginPath();
  ctx.rect(CHART_MARGIN.left, 0, plot.width - CHART_MARGIN.left - CHART_MARGIN.right, bottom + 1);
  ctx.clip();
  for (const each of series) drawSeries(app, plot, ctx, each, toY);
  if (chart === "error") drawRmse(app, plot, ctx, toY);
  ctx.restore();

  // The unit, above what it may cover.
  const [, sign] = valueUnit(app, chart, app.store.state.units, range);
  ctx.font = "11px system-ui, sans-serif";
  ctx.lineWidth = 4;
  ctx.strokeStyle = THEMES[theme].paper;
  ctx.fillStyle = THEMES[theme].muted;
  ctx.globalAlpha = 1;
  ctx.strokeText(sign, CHART_MARGIN.left + 6, CHART_MARGIN.top + 6);
  ctx.fillText(sign, CHART_MARGIN.left + 6, CHART_MARGIN.top + 6);
}

/**
 * Draw the root mean square error of each archive as a dashed line.
 * @param {App} app
 * @param {Plot} plot
 * @param {CanvasRenderingContext2D} ctx
 * @param {(value: number) => number} toY
 */
function drawRmse(app, plot, ctx, toY) {
  const { theme, units } = app.store.state;
  const right = plot.width - CHART_MARGIN.right;
  ctx.globalAlpha = 1;
  ctx.textAlign = "right";
  for (const { rmse, index } of app.scene.archives) {
    if (rmse === null) continue;
    const y = Math.round(toY(rmse)) + 0.5;
    ctx.strokeStyle = ctx.fillStyle = THEMES[theme].ink;
    ctx.lineWidth = 1;
    ctx.setLineDash([5, 3]);
    ctx.beginPath();
    ctx.moveTo(CHART_MARGIN.left, y);
    ctx.lineTo(right, y);
    ctx.stroke();
    ctx.setLineDash([]);

    // Its value, above the line at the right.
    const name = app.scene.archives.length > 1 ? (index ? "B " : "A ") : "";
    ctx.lineWidth = 4;
    ctx.strokeStyle = THEMES[theme].paper;
    ctx.strokeText(`${name}RMSE ${formatLength(rmse, units)}`, right - 6, y - 5);
    ctx.fillText(`${name}RMSE ${formatLength(rmse, units)}`, right - 6, y - 5);
  }
  ctx.textAlign = "left";
}

/**
 * Numbers of a part's values in a range of times; for lines with one more on each side.
 * @param {Series} series
 * @param {import("./series.js").Part} part
 * @param {[number, number]} domain
 * @returns {[number, number]}
 */
function partRange({ time }, { from, to, shift }, domain) {
  const first = lastAtMost(time, domain[0] + shift, from, to);
  const last = lastAtMost(time, domain[1] + shift, from, to);
  return [Math.max(first, from), Math.min(last + 2, to)];
}

/**
 * Range of the vertical axis.
 * @param {Series[]} series
 * @param {[number, number]} domain
 * @param {string} chart
 * @returns {[number, number]}
 */
function verticalRange(series, domain, chart) {
  let [low, high] = [Infinity, -Infinity];
  for (const each of series) {
    if (chart === "speed") {
      if (each.kind === "step") high = Math.max(high, usualTop(each, domain) * SHOWN_FACTOR);
      continue;
    }
    for (const part of each.parts) {
      for (const value of each.value.subarray(...partRange(each, part, domain))) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
  }

  // Speeds and errors start at 0; nothing is drawn at the very top.
  if (chart === "speed" || chart === "error") low = 0;
  if (!(low < high)) [low, high] = Number.isFinite(low) && low ? [low - 1, low + 1] : [0, 1];
  const space = (high - low) * 0.06;
  return [low && low - space, high + space];
}

/**
 * Value of a step series that is exceeded for a small share of the time only.
 * @param {Series} series
 * @param {[number, number]} domain
 */
function usualTop(series, domain) {
  /** @type {[number, number][]} */
  const steps = [];
  let total = 0;
  for (const part of series.parts) {
    const [from, to] = partRange(series, part, domain);
    for (let k = Math.max(from, part.from + 1); k < to; k++) {
      if (Number.isNaN(series.value[k])) continue;
      steps.push([series.value[k], series.time[k] - series.time[k - 1]]);
      total += series.time[k] - series.time[k - 1];
    }
  }

  // From the top until the share is used up.
  steps.sort((a, b) => b[0] - a[0]);
  let above = 0;
  const top = steps.find(([, duration]) => (above += duration) > total * (1 - SHOWN_SHARE));
  return top ? top[0] : 0;
}

/**
 * Draw the lines and labels of values.
 * @param {App} app
 * @param {Plot} plot
 * @param {CanvasRenderingContext2D} ctx
 * @param {[number, number]} range
 * @param {(value: number) => number} toY
 */
function drawValueAxis(app, plot, ctx, range, toY) {
  const { chart, units, theme } = app.store.state;
  const bottom = plot.height - CHART_MARGIN.bottom;
  const [size] = valueUnit(app, chart, units, range);
  const count = Math.max((bottom - CHART_MARGIN.top) / VALUE_PIXELS, 2);
  const step = niceStep((range[1] - range[0]) / size, count);
  ctx.font = "11px system-ui, sans-serif";
  ctx.textAlign = "right";
  ctx.strokeStyle = THEMES[theme].grid;
  ctx.fillStyle = THEMES[theme].muted;
  ctx.lineWidth = 1;
  for (let i = Math.ceil(range[0] / size / step); i * step * size <= range[1]; i++) {
    const y = Math.round(toY(i * step * size)) + 0.5;
    ctx.beginPath();
    ctx.moveTo(CHART_MARGIN.left, y);
    ctx.lineTo(plot.width - CHART_MARGIN.right, y);
    ctx.stroke();
    ctx.fillText(formatNumber(Math.round(i * step * 1e9) / 1e9, 5), CHART_MARGIN.left - 8, y + 4);
  }
  ctx.textAlign = "left";
}

/**
 * Draw the ticks and labels of times.
 * @param {App} app
 * @param {Plot} plot
 * @param {CanvasRenderingContext2D} ctx
 */
function drawTimeAxis(app, plot, ctx) {
  const { domain, zone, theme } = app.store.state;
  const bottom = plot.height - CHART_MARGIN.bottom;
  const epoch = clockEpoch(app);
  const inner = plot.width - CHART_MARGIN.left - CHART_MARGIN.right;
  const ticks = timeTicks(domain, inner / TICK_PIXELS, epoch, zone);
  ctx.textAlign = "center";
  ctx.strokeStyle = THEMES[theme].grid;
  ctx.fillStyle = THEMES[theme].muted;
  for (const time of ticks.times) {
    const x = Math.round(timeToX(plot, domain, time)) + 0.5;
    ctx.beginPath();
    ctx.moveTo(x, bottom);
    ctx.lineTo(x, bottom + 4);
    ctx.stroke();
    const text = tickText(app, time, ticks.step, epoch);
    const half = ctx.measureText(text).width / 2;
    ctx.fillText(text, Math.min(Math.max(x, half + 2), plot.width - half - 2), bottom + 16);
  }
  ctx.textAlign = "left";
}

/**
 * Text of a tick of the time axis: the date where a day begins or ticks are days.
 * @param {App} app
 * @param {number} time
 * @param {number} step
 * @param {import("./times.js").Epoch} epoch
 */
function tickText(app, time, step, epoch) {
  const { zone, units } = app.store.state;
  if (epoch === null) {
    const [size, sign] = lengthUnit(step, units);
    return `${formatNumber(time / size, 5)}\u202f${sign}`;
  }
  const clock = formatTime(time, epoch, zone, step, "time");
  const isDay = epoch === "unix" && (step >= 86400 || /^00:00(:00)?$/.test(clock));
  return isDay ? formatTime(time, epoch, zone, step, "date") : clock;
}

/**
 * Unit of the vertical axis: metres or metres a second of it, and its sign.
 * @param {App} app
 * @param {string} chart
 * @param {string} units
 * @param {[number, number]} range
 * @returns {[number, string]}
 */
function valueUnit(app, chart, units, range) {
  const unit = chartKinds(app.scene).find(({ id }) => id === chart)?.unit;
  if (unit === "speed") return UNITS[units].speed;
  if (unit === "length")
    return lengthUnit(Math.max(Math.abs(range[0]), Math.abs(range[1])) / 4, units);
  return [1, ""];
}

/**
 * Draw a series: value by value, or the extremes of each pixel.
 * @param {App} app
 * @param {Plot} plot
 * @param {CanvasRenderingContext2D} ctx
 * @param {Series} series
 * @param {(value: number) => number} toY
 */
function drawSeries(app, plot, ctx, series, toY) {
  const { domain, theme } = app.store.state;
  const ranges = series.parts.map((part) => partRange(series, part, domain));
  const count = ranges.reduce((sum, [from, to]) => sum + Math.max(to - from, 0), 0);
  ctx.fillStyle = ctx.strokeStyle = THEMES[theme][series.colour];
  ctx.globalAlpha = series.colour === "raw" ? RAW_OPACITY : 1;
  ctx.lineWidth = 1.5;
  ctx.lineJoin = "round";
  const isCloud = series.kind === "cloud";
  if (count > MAX_SINGLE && !isCloud) return drawExtremes(plot, ctx, series, ranges, domain, toY);
  if (isCloud || series.kind === "dots") {
    const every = isCloud ? Math.ceil(count / MAX_SINGLE) : 1;
    return drawDots(plot, ctx, series, ranges, domain, toY, every);
  }

  // A path that is broken where a value is unknown.
  ctx.beginPath();
  series.parts.forEach(({ shift, from }, i) => {
    let isDown = false;
    for (let k = ranges[i][0]; k < ranges[i][1]; k++) {
      if (series.joined && !series.joined[k]) isDown = false;
      const x = timeToX(plot, domain, series.time[k] - shift);
      const y = toY(series.value[k]);
      if (series.kind === "line") isDown = addPoint(ctx, x, y, isDown);
      else if (k > from) {
        isDown = addPoint(ctx, timeToX(plot, domain, series.time[k - 1] - shift), y, isDown);
        isDown = addPoint(ctx, x, y, isDown);
      }
    }
  });
  ctx.stroke();
}

/**
 * Draw values as dots.
 * @param {Plot} plot
 * @param {CanvasRenderingContext2D} ctx
 * @param {Series} series
 * @param {[number, number][]} ranges
 * @param {[number, number]} domain
 * @param {(value: number) => number} toY
 * @param {number} every draw one of so many values
 */
function drawDots(plot, ctx, series, ranges, domain, toY, every) {
  ctx.beginPath();
  series.parts.forEach(({ shift }, i) => {
    for (let k = ranges[i][0]; k < ranges[i][1]; k += every) {
      const x = timeToX(plot, domain, series.time[k] - shift);
      ctx.rect(x - 1, toY(series.value[k]) - 1, 2, 2);
    }
  });
  ctx.fill();
}

/**
 * Add a point to a path.
 * @param {CanvasRenderingContext2D} ctx
 * @param {number} x
 * @param {number} y NaN breaks the path
 * @param {boolean} isDown whether a line leads here
 * @returns {boolean} whether a line leads on
 */
function addPoint(ctx, x, y, isDown) {
  if (Number.isNaN(y)) return false;
  if (isDown) ctx.lineTo(x, y);
  else ctx.moveTo(x, y);
  return true;
}

/**
 * Draw a bar from the smallest to the largest value of each pixel of the time axis.
 * @param {Plot} plot
 * @param {CanvasRenderingContext2D} ctx
 * @param {Series} series
 * @param {[number, number][]} ranges
 * @param {[number, number]} domain
 * @param {(value: number) => number} toY
 */
function drawExtremes(plot, ctx, series, ranges, domain, toY) {
  const columns = Math.ceil(plot.width) + 1;
  const low = new Float64Array(columns).fill(Infinity);
  const high = new Float64Array(columns).fill(-Infinity);
  series.parts.forEach(({ shift }, i) => {
    for (let k = ranges[i][0]; k < ranges[i][1]; k++) {
      const value = series.value[k];
      if (Number.isNaN(value)) continue;

      // A step covers all pixels since the number before.
      const end = Math.floor(timeToX(plot, domain, series.time[k] - shift));
      const hasStart = series.kind === "step" && k > 0;
      const start = hasStart ? Math.floor(timeToX(plot, domain, series.time[k - 1] - shift)) : end;
      for (let x = Math.max(start, 0); x <= Math.min(end, columns - 1); x++) {
        if (value < low[x]) low[x] = value;
        if (value > high[x]) high[x] = value;
      }
    }
  });
  for (let x = 0; x < columns; x++) {
    if (low[x] > high[x]) continue;
    const top = toY(high[x]) - 0.75;
    ctx.fillRect(x, top, 1, Math.max(toY(low[x]) + 0.75 - top, 1.5));
  }
}

/**
 * Draw the range, the cursor of the clock, and the time under the pointer.
 * @param {App} app
 * @param {Plot} plot
 */
export function drawChartOverlay(app, plot) {
  const { domain, range, time, hover, theme } = app.store.state;
  const colours = THEMES[theme];
  const ctx = chartContext(plot.overlay, plot.ratio);
  const bottom = plot.height - CHART_MARGIN.bottom;
  const right = plot.width - CHART_MARGIN.right;
  ctx.clearRect(0, 0, plot.width, plot.height);
  if (range) {
    const from = Math.max(timeToX(plot, domain, range[0]), CHART_MARGIN.left);
    const to = Math.min(timeToX(plot, domain, range[1]), right);
    ctx.fillStyle = `${colours.accent}2e`;
    ctx.fillRect(from, 0, Math.max(to - from, 0), bottom);
    ctx.fillStyle = colours.accent;
    for (const x of [from, to]) ctx.fillRect(x - 0.75, 0, 1.5, to > from ? bottom : 0);
  }

  // A thin line under the pointer, a thick one at the time of the clock.
  for (const [at, width, colour] of /** @type {[number | null, number, string][]} */ ([
    [hover, 1, colours.muted],
    [time, 2, colours.ink],
  ])) {
    if (at === null || at < domain[0] || at > domain[1]) continue;
    const x = timeToX(plot, domain, at);
    ctx.fillStyle = colour;
    ctx.fillRect(x - width / 2, 0, width, bottom);
  }
  if (hover !== null) drawHoverText(app, plot, ctx, hover);
}

/**
 * Write the time and the values under the pointer.
 * @param {App} app
 * @param {Plot} plot
 * @param {CanvasRenderingContext2D} ctx
 * @param {number} hover
 */
function drawHoverText(app, plot, ctx, hover) {
  const { domain, zone, chart, units, theme } = app.store.state;
  const epoch = clockEpoch(app);
  const step = (domain[1] - domain[0]) / plot.width;
  const texts = [formatTime(hover, epoch, zone, Math.min(step, 59))];
  for (const series of chartSeries(app)) {
    const value = valueAt(series, hover);
    const [size, sign] = valueUnit(app, chart, units, [0, 4 * value]);
    if (!Number.isNaN(value))
      texts.push(`${series.label} ${formatNumber(value / size)}\u202f${sign}`);
  }

  // A label beside the pointer, inside of the chart.
  const text = texts.join("   ");
  ctx.font = "600 11px system-ui, sans-serif";
  const width = ctx.measureText(text).width + 12;
  const x = timeToX(plot, domain, hover);
  const left = x + 8 + width > plot.width ? x - 8 - width : x + 8;
  ctx.fillStyle = THEMES[theme].ink;
  ctx.fillRect(left, 4, width, 20);
  ctx.fillStyle = THEMES[theme].paper;
  ctx.fillText(text, left + 6, 18);
}

/**
 * Value of a series at a time of the clock; of several tracks, the first that has one.
 * @param {Series} series
 * @param {number} time
 */
function valueAt(series, time) {
  for (const { from, to, shift } of series.parts) {
    const k = lastAtMost(series.time, time + shift, from, to);
    if (k < from || k + 1 >= to) continue;
    if (series.kind === "step") return series.value[k + 1];
    return series.value[k];
  }
  return NaN;
}
