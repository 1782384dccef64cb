/**
 * The chart under the map: series over time, with a cursor and a range.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./series.js").Series} Series
 * @typedef {import("./curves.js").Plot} Plot
 */

import { clockEpoch, clockShift, clockTracks } from "./clock.js";
import { CHART_MARGIN, drawSeries, partRange, timeToX } from "./curves.js";
import { UNITS, formatLength, formatNumber, formatSpeed, lengthUnit, niceStep } from "./format.js";
import { THEMES } from "./colours.js";
import { chartKinds, chartSeries } from "./series.js";
import { formatTime, timeTicks } from "./times.js";
import { lastAtMost, measureWalk, usualTop } from "./walks.js";

/** Share of the time whose speeds fit into the chart, and by how much more: the rest is noise. */
const SHOWN_SHARE = 0.995;
const SHOWN_FACTOR = 1.5;

/** CSS pixels between ticks of the time axis, and between values, about. */
const TICK_PIXELS = 110;
const VALUE_PIXELS = 34;

/** CSS pixels from the line of the highest number down to the foot of the unit. */
const UNIT_PIXELS = 17;

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
  if (chart === "speed") drawHigher(app, plot, ctx, topSpeed(app), range[1]);
}

/**
 * Say how far values go above the chart, if they do.
 * @param {App} app
 * @param {Plot} plot
 * @param {CanvasRenderingContext2D} ctx
 * @param {number} highest metres a second
 * @param {number} shown metres a second at the top of the chart
 */
function drawHigher(app, plot, ctx, highest, shown) {
  if (highest <= shown) return;
  const { theme, units } = app.store.state;
  const text = `\u2191 up to ${formatSpeed(highest, units)}`;
  ctx.globalAlpha = 1;
  ctx.textAlign = "right";
  ctx.lineWidth = 4;
  ctx.strokeStyle = THEMES[theme].paper;
  ctx.fillStyle = THEMES[theme].ink;
  const right = plot.width - CHART_MARGIN.right - 6;
  ctx.strokeText(text, right, CHART_MARGIN.top + 4);
  ctx.fillText(text, right, CHART_MARGIN.top + 4);
  ctx.textAlign = "left";
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
      if (each.kind !== "step") continue;
      high = Math.max(high, usualTop(stepsOf(each, domain), SHOWN_SHARE) * SHOWN_FACTOR);
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
 * Values of a step series, and the seconds for which each holds.
 * @param {Series} series
 * @param {[number, number]} domain
 */
function stepsOf(series, domain) {
  return series.parts.flatMap((part) => {
    const [from, to] = partRange(series, part, domain);
    const first = Math.max(from, part.from + 1);
    return Array.from(series.value.subarray(first, to), (value, i) => ({
      value,
      duration: series.time[first + i] - series.time[first + i - 1],
    }));
  });
}

/**
 * Largest speed in the chart, without jumps of the receiver.
 * @param {App} app
 */
function topSpeed(app) {
  const [start, end] = app.store.state.domain;
  let fastest = 0;
  for (const archive of app.scene.archives) {
    for (const track of clockTracks(app, archive)) {
      const shift = clockShift(app, archive, track);
      fastest = Math.max(
        fastest,
        measureWalk(archive, track, [start + shift, end + shift]).fastest,
      );
    }
  }
  return fastest;
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
  const [size, sign] = valueUnit(app, chart, units, range);
  const count = Math.max((bottom - CHART_MARGIN.top) / VALUE_PIXELS, 2);
  const step = niceStep((range[1] - range[0]) / size, count);
  ctx.font = "11px system-ui, sans-serif";
  ctx.textAlign = "right";
  ctx.strokeStyle = THEMES[theme].grid;
  ctx.fillStyle = THEMES[theme].muted;
  ctx.lineWidth = 1;
  let highest = CHART_MARGIN.top;
  for (let i = Math.ceil(range[0] / size / step); i * step * size <= range[1]; i++) {
    const y = Math.round(toY(i * step * size)) + 0.5;
    ctx.beginPath();
    ctx.moveTo(CHART_MARGIN.left, y);
    ctx.lineTo(plot.width - CHART_MARGIN.right, y);
    ctx.stroke();
    ctx.fillText(formatNumber(Math.round(i * step * 1e9) / 1e9, 5), CHART_MARGIN.left - 8, y + 4);
    highest = y;
  }

  // The unit, below the highest number.
  ctx.fillText(sign, CHART_MARGIN.left - 8, highest + UNIT_PIXELS);
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
