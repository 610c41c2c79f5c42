{
  const next = requestAnimationFrame.bind(globalThis);
  globalThis.requestAnimationFrame = (draw) => setTimeout(() => {
    // The whole program may have stopped to draw: see browser.py
    const late = setInterval(() => { if (!document.hidden) console.debug('no picture'); }, 20000);
    next((now) => { clearInterval(late); draw(now); });
  }, 480);
}
