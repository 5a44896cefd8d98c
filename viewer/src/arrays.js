// Arrays of numbers that the page holds as base64; those of several bytes are little-endian.

export function bytes(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

export function signed(text) {
  return new Int8Array(bytes(text).buffer);
}

export function words(text) {
  return new Uint16Array(bytes(text).buffer);
}
