// When the server does not let this page in any more (it was started anew, the person was signed out elsewhere),
// go and sign in again, and come back to the same view.
function msbotSignIn() {
  location.href = "/login?next=" + encodeURIComponent(location.pathname + location.search);
}

setInterval(async () => {
  if (!window.socket || window.socket.connected) return;
  try {
    const answer = await fetch("/api/me");
    if (answer.status === 401) msbotSignIn();
  } catch {
    // The server is not there (yet): look again next time.
  }
}, 2000);
