/**
 * Curves of a chart: where times are, and the series of values over them.
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

import { THEMES } from "./colours.js";
import { lastAtMost } from "./walks.js";

/** CSS pixels around the plot. */
export const CHART_MARGIN = { left: 52, right: 14, top: 10, bottom: 22 };

/** Values of a series that are drawn one by one at most; of more, the extremes of each pixel. */
const MAX_SINGLE = 5000;

/** Opacity of samples behind the walks, and of extremes behind means. */
const RAW_OPACITY = 0.55;
const EXTREMES_OPACITY = 0.35;

/**
 * Horizontal place of a time.
 * @param {Plot} plot
 * @param {[number, number]} domain
 * @param {number} time
 */
export function timeToX(plot, domain, time) {
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
 * Numbers of a part's values in a range of times; for lines with one more on each side.
 * @param {Series} series
 * @param {import("./series.js").Part} part
 * @param {[number, number]} domain
 * @returns {[number, number]}
 */
export function partRange({ time }, { from, to, shift }, domain) {
  const first = lastAtMost(time, domain[0] + shift, from, to);
  const last = lastAtMost(time, domain[1] + shift, from, to);
  return [Math.max(first, from), Math.min(last + 2, to)];
}

/**
 * Draw a series: value by value, or the extremes of each pixel.
 * @param {App} app
 * @param {Plot} plot
 * @param {CanvasRenderingContext2D} ctx
 * @param {Series} series
 * @param {(value: number) => number} toY
 */
export function drawSeries(app, plot, ctx, series, toY) {
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
 * Draw a pale bar from the smallest to the largest value of each pixel of the time axis, and a line
 * through the means.
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
  const sums = new Float64Array(columns);
  const weights = new Float64Array(columns);
  series.parts.forEach(({ shift, from }, i) => {
    for (let k = ranges[i][0]; k < ranges[i][1]; k++) {
      const value = series.value[k];
      if (Number.isNaN(value)) continue;

      // A step covers all pixels since the number before, each by a part.
      const isStep = series.kind === "step" && k > from;
      const end = timeToX(plot, domain, series.time[k] - shift);
      const start = isStep ? timeToX(plot, domain, series.time[k - 1] - shift) : end;
      const last = Math.min(Math.floor(end), columns - 1);
      for (let x = Math.max(Math.floor(start), 0); x <= last; x++) {
        const weight = isStep ? Math.min(end, x + 1) - Math.max(start, x) : 1;
        sums[x] += weight * value;
        weights[x] += weight;
        if (value < low[x]) low[x] = value;
        if (value > high[x]) high[x] = value;
      }
    }
  });

  // The bars, then the line.
  const opacity = ctx.globalAlpha;
  ctx.globalAlpha = opacity * EXTREMES_OPACITY;
  for (let x = 0; x < columns; x++) {
    if (low[x] > high[x]) continue;
    const top = toY(high[x]) - 0.75;
    ctx.fillRect(x, top, 1, Math.max(toY(low[x]) + 0.75 - top, 1.5));
  }
  ctx.globalAlpha = opacity;
  ctx.beginPath();
  let isDown = false;
  for (let x = 0; x < columns; x++)
    isDown = addPoint(ctx, x + 0.5, weights[x] ? toY(sums[x] / weights[x]) : NaN, isDown);
  ctx.stroke();
}
