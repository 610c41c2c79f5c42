// Canvases that are seen, and how many colours are in each.
Object.fromEntries([...document.querySelectorAll('canvas')].filter((one) => one.width && one.offsetParent).map((one) => {
  const { data } = one.getContext('2d').getImageData(0, 0, one.width, one.height);
  return [one.id || one.parentElement.className, new Set(new Uint32Array(data.buffer)).size];
}))
