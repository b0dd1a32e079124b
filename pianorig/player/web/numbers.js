// Arrays from the server, and values between their samples.

/** 32-bit numbers of {f32, shape}. */
export function unpack(packed) {
  if (!packed) return null;
  const text = atob(packed.f32), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return new Float32Array(bytes.buffer);
}

/** Index of the last sample at or before a time; 0 before the first. */
export function indexAt(times, t) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

/** Index of the sample nearest to a time. */
export function nearest(times, t) {
  const i = indexAt(times, t);
  return i + 1 < times.length && times[i + 1] - t < t - times[i] ? i + 1 : i;
}

/** Value at a time by a straight line; NaN outside. */
export function valueAt(times, values, t) {
  if (!times.length || t < times[0] || t > times[times.length - 1]) return NaN;
  const i = Math.min(indexAt(times, t), times.length - 2);
  if (i < 0) return values[0];
  const share = (t - times[i]) / (times[i + 1] - times[i]);
  return values[i] + share * (values[i + 1] - values[i]);
}
