/**
 * Transverse Mercator projection of WGS84 with scale 1, by Krueger's series.
 *
 * C. F. F. Karney, Transverse Mercator with an accuracy of a few nanometers, J. Geodesy 85 (2011),
 * equations 7 to 14 and 35, 36, up to the fourth power of the third flattening n.
 */

/** Metres of the equatorial radius, and flattening, of WGS84. */
const RADIUS = 6378137;
const FLATTENING = 1 / 298.257223563;

const ECCENTRICITY = Math.sqrt(FLATTENING * (2 - FLATTENING));
const THIRD = FLATTENING / (2 - FLATTENING);

/** Metres of a meridian for a radian. */
const RECTIFYING = (RADIUS / (1 + THIRD)) * (1 + THIRD ** 2 / 4 + THIRD ** 4 / 64);

/** Coefficients from the conformal sphere to the plane. */
const ALPHA = [
  THIRD / 2 - (2 / 3) * THIRD ** 2 + (5 / 16) * THIRD ** 3 + (41 / 180) * THIRD ** 4,
  (13 / 48) * THIRD ** 2 - (3 / 5) * THIRD ** 3 + (557 / 1440) * THIRD ** 4,
  (61 / 240) * THIRD ** 3 - (103 / 140) * THIRD ** 4,
  (49561 / 161280) * THIRD ** 4,
];

/** Coefficients from the plane to the conformal sphere. */
const BETA = [
  THIRD / 2 - (2 / 3) * THIRD ** 2 + (37 / 96) * THIRD ** 3 - (1 / 360) * THIRD ** 4,
  (1 / 48) * THIRD ** 2 + (1 / 15) * THIRD ** 3 - (437 / 1440) * THIRD ** 4,
  (17 / 480) * THIRD ** 3 - (37 / 840) * THIRD ** 4,
  (4397 / 161280) * THIRD ** 4,
];

const RADIANS = Math.PI / 180;

/**
 * Position on the plane about a centre.
 * @param {number} lat degrees
 * @param {number} lon degrees
 * @param {[number, number]} center latitude and longitude of the centre in degrees
 * @returns {[number, number]} x to the east and y to the north, in metres
 */
export function toPlane(lat, lon, center) {
  const [east, north] = sphereToPlane(lat * RADIANS, (lon - center[1]) * RADIANS);
  const [, origin] = sphereToPlane(center[0] * RADIANS, 0);
  return [RECTIFYING * east, RECTIFYING * (north - origin)];
}

/**
 * Latitude and longitude of a position on the plane about a centre.
 * @param {number} x metres
 * @param {number} y metres
 * @param {[number, number]} center latitude and longitude of the centre in degrees
 * @returns {[number, number]} latitude, and longitude in [-180, 180), in degrees
 */
export function toDegrees(x, y, center) {
  const [, origin] = sphereToPlane(center[0] * RADIANS, 0);
  const [eta, xi] = addSeries(x / RECTIFYING, y / RECTIFYING + origin, BETA, -1);
  const tangent = Math.sin(xi) / Math.hypot(Math.sinh(eta), Math.cos(xi));
  const lat = Math.atan(fromConformal(tangent)) / RADIANS;
  const lon = center[1] + Math.atan2(Math.sinh(eta), Math.cos(xi)) / RADIANS;
  return [lat, ((((lon + 180) % 360) + 360) % 360) - 180];
}

/**
 * @param {number} lat radians
 * @param {number} lon radians from the central meridian
 * @returns {[number, number]} to the east and north, in radians of a meridian
 */
function sphereToPlane(lat, lon) {
  const tangent = toConformal(Math.tan(lat));
  const xi = Math.atan2(tangent, Math.cos(lon));
  const eta = Math.asinh(Math.sin(lon) / Math.hypot(tangent, Math.cos(lon)));
  return addSeries(eta, xi, ALPHA, 1);
}

/**
 * @param {number} eta
 * @param {number} xi
 * @param {number[]} coefficients
 * @param {number} sign
 * @returns {[number, number]}
 */
function addSeries(eta, xi, coefficients, sign) {
  let [east, north] = [eta, xi];
  coefficients.forEach((coefficient, i) => {
    const order = 2 * (i + 1);
    east += sign * coefficient * Math.cos(order * xi) * Math.sinh(order * eta);
    north += sign * coefficient * Math.sin(order * xi) * Math.cosh(order * eta);
  });
  return [east, north];
}

/**
 * Tangent of the conformal latitude.
 * @param {number} tangent of the latitude
 */
function toConformal(tangent) {
  const sine = tangent / Math.hypot(1, tangent);
  const shift = Math.sinh(ECCENTRICITY * Math.atanh(ECCENTRICITY * sine));
  return tangent * Math.hypot(1, shift) - shift * Math.hypot(1, tangent);
}

/**
 * Tangent of the latitude, by Newton's method; two steps reach the precision of doubles.
 * @param {number} conformal tangent of the conformal latitude
 */
function fromConformal(conformal) {
  const square = 1 - ECCENTRICITY ** 2;
  let tangent = conformal / square;
  for (let i = 0; i < 4; i++) {
    const value = toConformal(tangent);
    tangent +=
      ((conformal - value) / Math.hypot(1, value)) *
      ((1 + square * tangent ** 2) / (square * Math.hypot(1, tangent)));
  }
  return tangent;
}
